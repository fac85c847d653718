// SPDX-License-Identifier: Apache-2.0
//
// Reads the frames of videos as images of a store.
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

/// The frames of a video, decoded by OpenCV's videoio and FFmpeg in a process of its own
/// (`VideoDecoder`). Reading them in order is fastest. To read a frame before the latest one, the
/// decoder seeks it by its time or decodes from the beginning.
class VideoStore : public ImageStore {
 public:
  /// Decodes the whole video once to count the frames and read their times. Throws `Error` of kind
  /// kInput if it cannot be decoded, and of kind kJob if the decoder cannot be started.
  explicit VideoStore(std::filesystem::path path);
  ~VideoStore() override;
  VideoStore(const VideoStore&) = delete;
  VideoStore& operator=(const VideoStore&) = delete;

  [[nodiscard]] StoredImage Read(size_t index) const override;
  [[nodiscard]] StoredImage Start(size_t index, size_t most) const override;
  [[nodiscard]] std::string Hash(size_t index) const override;
  [[nodiscard]] bool HasFiles() const override { return false; }

  /// Times of the frames, s since the beginning; empty if the video has none that increase.
  [[nodiscard]] const std::vector<double>& Times() const { return times_; }
  [[nodiscard]] size_t Count() const { return count_; }
  /// Remarks on unusual properties of the file, in whole sentences.
  [[nodiscard]] const std::vector<std::string>& Notes() const { return notes_; }

 private:
  void Open() const;
  /// Decodes the next frame and returns its time, s; nothing at the end.
  std::optional<double> Grab() const;
  [[nodiscard]] StoredImage Retrieve() const;
  void CountFrames();
  /// Moves the decoder so that `next_` is `index`.
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
  /// Latest frames that were skipped on the way to a later one; other threads may read them next.
  mutable std::deque<std::pair<size_t, StoredImage>> passed_;
};

/// Names that end in .mp4, .avi, .mkv, .mov, .webm, ...
bool IsVideoName(const std::filesystem::path& path);

/// The frames of a video, named by their numbers from 0 on.
std::vector<FrameImage> VideoImages(const std::filesystem::path& path,
                                    std::vector<std::string>* notes);

}  // namespace plenocal
