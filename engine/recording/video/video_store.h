// SPDX-License-Identifier: Apache-2.0
//
// Videos as stores of images.
#pragma once

#include <deque>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calib/files/frame_images.h"

namespace plenocal {

class VideoDecoder;

/// Has the frames decoded one after the other by OpenCV's videoio and FFmpeg, in a process of its
/// own. Frames are found fastest in their order; of those before the latest one the video is
/// decoded again.
class VideoStore : public ImageStore {
 public:
  /// Decodes all of it once, for the number of frames and their times. Throws `Error` of kind
  /// kInput for what cannot be decoded, and of kind kJob when the decoder cannot be started.
  explicit VideoStore(std::filesystem::path path);
  ~VideoStore() override;
  VideoStore(const VideoStore&) = delete;
  VideoStore& operator=(const VideoStore&) = delete;

  [[nodiscard]] StoredImage Read(size_t index) const override;
  [[nodiscard]] StoredImage Start(size_t index, size_t most) const override;
  [[nodiscard]] std::string Hash(size_t index) const override;
  [[nodiscard]] bool HasFiles() const override { return false; }

  /// Seconds since its beginning; of a video that states none nothing.
  [[nodiscard]] const std::vector<double>& Times() const { return times_; }
  [[nodiscard]] size_t Count() const { return count_; }
  /// Notes on what is unusual, in whole sentences.
  [[nodiscard]] const std::vector<std::string>& Notes() const { return notes_; }

 private:
  void Open() const;
  /// Decodes the frame after the latest one and gives its time in s; nothing at the end.
  std::optional<double> Grab() const;
  [[nodiscard]] StoredImage Retrieve() const;
  void CountFrames();
  /// Makes `next_` the frame `index`.
  void GoTo(size_t index) const;

  std::filesystem::path path_;
  std::string hash_;  // of the file
  size_t count_ = 0;
  ImageSize size_{};
  std::vector<double> times_;
  std::vector<std::string> notes_;
  mutable std::mutex mutex_;
  mutable std::unique_ptr<VideoDecoder> video_;
  mutable size_t next_ = 0;  // the frame that is decoded next
  /// Frames that other threads have asked to pass over and that may be asked for next.
  mutable std::deque<std::pair<size_t, StoredImage>> passed_;
};

/// Names that end in .mp4, .avi, .mkv, .mov, .webm, ...
bool IsVideoName(const std::filesystem::path& path);

/// The frames of a video, called after their numbers from 0 on.
std::vector<FrameImage> VideoImages(const std::filesystem::path& path,
                                    std::vector<std::string>* notes);

}  // namespace plenocal
