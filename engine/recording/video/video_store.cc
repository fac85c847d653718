// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/video/video_store.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/base/parallel.h"
#include "calib/io/detection_cache.h"
#include "calib/io/input_file.h"
#include "engine/recording/messages/byte_range.h"
#include "engine/recording/video/video_decoder.h"

namespace plenocal {
namespace {

/// Hash of a file of any size.
std::string HashOfAll(const std::filesystem::path& path) {
  constexpr std::uint64_t kBlock = std::uint64_t{16} << 20;
  const InputBytes file(path);
  std::string hashes;
  for (std::uint64_t at = 0; at < file.Size(); at += kBlock) {
    ByteVector block(std::min(kBlock, file.Size() - at));
    file.Read(at, block);
    hashes += HashBytes(block);
  }
  return HashBytes(ByteVector(hashes.begin(), hashes.end()));
}

}  // namespace

VideoStore::VideoStore(std::filesystem::path path)
    : path_(std::move(path)), hash_(HashOfAll(path_)) {
  CountFrames();
}

VideoStore::~VideoStore() = default;

void VideoStore::Open() const {
  video_ = std::make_unique<VideoDecoder>(path_);
  next_ = 0;
  if (video_->Opened().good) return;
  video_.reset();
  throw InputError(
      "{}: is no video that FFmpeg can open: damaged, cut off (an MP4 "
      "without its end has no index), or its codec is missing; copy it "
      "again, or extract the frames: ffmpeg -i VIDEO frames/%06d.png",
      path_.string());
}

std::optional<double> VideoStore::Grab() const {
  const VideoAnswer answer = video_->Ask(VideoRequest::kGrab);
  if (!answer.good) return {};
  ++next_;
  return answer.time;
}

StoredImage VideoStore::Retrieve() const {
  const VideoAnswer answer = video_->Ask(VideoRequest::kRetrieve);
  StoredImage image;
  image.encoding = "bgr8";
  image.size = {answer.width, answer.height};
  image.step = 3 * static_cast<size_t>(answer.width);
  image.bytes.resize(image.step * static_cast<size_t>(answer.height));
  if (!answer.good || !video_->Receive(image.bytes)) {
    throw InputError("{}: frame {} cannot be decoded", path_.string(), next_ - 1);
  }
  return image;
}

void VideoStore::CountFrames() {
  Open();
  const double stated = video_->Opened().frames;
  size_ = {video_->Opened().width, video_->Opened().height};
  while (const std::optional<double> time = Grab()) times_.push_back(*time);
  count_ = next_;
  if (count_ == 0) {
    throw InputError("{}: no frame can be decoded; is its codec installed?", path_.string());
  }
  // Containers round the duration, from which some give the number.
  constexpr double kRounding = 2;
  if (stated - static_cast<double>(count_) > kRounding) {
    notes_.push_back(fmt::format("{}: is cut off or damaged: {} of {:.0f} frames can be decoded",
                                 path_.string(),
                                 count_,
                                 stated));
  }
  const auto rising = [](double a, double b) { return !(a < b); };
  if (std::ranges::adjacent_find(times_, rising) != times_.end()) {
    if (count_ > 1) {
      notes_.push_back(
          fmt::format("{}: its times do not increase and are not used", path_.string()));
    }
    times_.clear();
  }
  video_.reset();
}

void VideoStore::GoTo(size_t index) const {
  if (!video_) Open();
  if (index < next_) {
    passed_.clear();
    // FFmpeg finds a frame by its time, which not all videos keep exactly.
    if (!times_.empty() && index > 0 && video_->Ask(VideoRequest::kSeek, index - 1).good) {
      const VideoAnswer before = video_->Ask(VideoRequest::kGrab);
      constexpr double kSame = 1e-6;  // s
      if (before.good && std::abs(before.time - times_[index - 1]) < kSame) {
        next_ = index;
        return;
      }
    }
    Open();
  }
  // Other threads may be about to read the frames just before.
  const size_t frame = 3 * static_cast<size_t>(size_[0]) * static_cast<size_t>(size_[1]);  // bytes
  const size_t kept =
      std::min(static_cast<size_t>(DefaultThreads()) + 2,
               static_cast<size_t>(InputLimit::kImage) / std::max<size_t>(1, frame));
  while (next_ < index) {
    const bool keep = index - next_ <= kept;
    if (!Grab()) break;
    if (keep) passed_.emplace_back(next_ - 1, Retrieve());
    if (passed_.size() > kept) passed_.pop_front();
  }
}

StoredImage VideoStore::Read(size_t index) const {
  const std::lock_guard lock(mutex_);
  const auto passed =
      std::ranges::find(passed_, index, [](const auto& entry) { return entry.first; });
  if (passed != passed_.end()) {
    StoredImage image = std::move(passed->second);
    passed_.erase(passed);
    return image;
  }
  GoTo(index);
  if (next_ != index || !Grab()) {
    throw InputError("{}: frame {} cannot be decoded", path_.string(), index);
  }
  return Retrieve();
}

StoredImage VideoStore::Start(size_t, size_t) const {
  return {.bytes = {}, .encoding = "bgr8", .size = size_};
}

std::string VideoStore::Hash(size_t index) const { return fmt::format("{} {}", hash_, index); }

bool IsVideoName(const std::filesystem::path& path) {
  static constexpr std::array kExtensions{
      ".mp4", ".m4v", ".avi", ".mkv", ".mov", ".webm", ".mpg", ".mpeg", ".ts", ".wmv"};
  const std::string extension = LowerCase(path.extension().string());
  return std::ranges::find(kExtensions, extension) != kExtensions.end();
}

std::vector<FrameImage> VideoImages(const std::filesystem::path& path,
                                    std::vector<std::string>* notes) {
  const auto store = std::make_shared<const VideoStore>(path);
  notes->insert(notes->end(), store->Notes().begin(), store->Notes().end());
  std::vector<FrameImage> images;
  for (size_t i = 0; i < store->Count(); ++i) {
    const std::string frame = fmt::format("{:06}", i);
    images.push_back(
        {.frame = frame, .path = path / frame, .store = store, .index = i, .time = {}});
    if (!store->Times().empty()) images.back().time = store->Times()[i];
  }
  return images;
}

}  // namespace plenocal
