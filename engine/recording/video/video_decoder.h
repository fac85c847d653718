// SPDX-License-Identifier: Apache-2.0
//
// Runs `plenocal-video`, the program that decodes a video for this process.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <filesystem>
#include <span>

#include "engine/recording/video/video_messages.h"

namespace plenocal {

/// One running decoder. Not thread-safe.
class VideoDecoder {
 public:
  /// Opens the video. Throws `Error` of kind kJob when the program cannot be started.
  explicit VideoDecoder(const std::filesystem::path& video);
  ~VideoDecoder();
  VideoDecoder(const VideoDecoder&) = delete;
  VideoDecoder& operator=(const VideoDecoder&) = delete;

  /// The answer to the opening of the file; not `good` if it is no video.
  [[nodiscard]] const VideoAnswer& Opened() const { return opened_; }
  /// Sends a request and returns the answer, which is not `good` if the decoder has ended.
  VideoAnswer Ask(VideoRequest request, std::size_t index = 0);
  /// Receives the pixels that follow an answer; false if the decoder has ended.
  bool Receive(std::span<std::uint8_t> pixels);

 private:
  /// Ends the program; returns its status as `waitpid` gives it.
  int End();

  pid_t process_ = 0;
  int socket_ = -1;
  VideoAnswer opened_;
};

}  // namespace plenocal
