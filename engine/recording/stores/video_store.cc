// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/stores/video_store.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <new>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/videoio.hpp>

#include "calib/base/format_error.h"
#include "calib/base/parallel.h"
#include "calib/io/detection_cache.h"
#include "calib/io/input_file.h"
#include "engine/recording/messages/byte_range.h"

namespace plenocal {
namespace {

constexpr const char* kConstructor = "_ZN2cv12VideoCaptureC1Ev";
constexpr double kMillisecond = 1e-3;

/// A reader of videos. The library is loaded with the first one, as imgcodecs is with the first
/// image (detectors/images/image_codecs.h): it brings FFmpeg and GStreamer. Only the constructor
/// is looked up by its symbol; all else are virtual functions.
std::unique_ptr<cv::VideoCapture> NewCapture() {
  using Construct = void(void* memory);
  static Construct* const kConstruct = [] {
    void* const library = dlopen(PLENOCAL_VIDEOIO, RTLD_NOW | RTLD_LOCAL);
    void* const symbol = library == nullptr ? nullptr : dlsym(library, kConstructor);
    if (symbol == nullptr) {
      throw JobError(
          "cannot load {}, which reads videos ({}); install OpenCV's videoio "
          "(Debian: libopencv-videoio406), or extract the frames: ffmpeg -i "
          "VIDEO frames/%06d.png",
          PLENOCAL_VIDEOIO,
          dlerror());
    }
    // Libraries report damage to standard error, frame by frame; the notes have it once.
    setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
    return reinterpret_cast<Construct*>(symbol);
  }();
  void* const memory = ::operator new(sizeof(cv::VideoCapture));
  kConstruct(memory);
  return std::unique_ptr<cv::VideoCapture>(static_cast<cv::VideoCapture*>(memory));
}

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
  video_ = NewCapture();
  if (!video_->open(path_.string(), cv::CAP_FFMPEG)) {
    throw InputError(
        "{}: is no video that FFmpeg can open: damaged, cut off (an MP4 "
        "without its end has no index), or its codec is missing; copy it "
        "again, or extract the frames: ffmpeg -i VIDEO frames/%06d.png",
        path_.string());
  }
  // A camera's pixels as they were recorded.
  video_->set(cv::CAP_PROP_ORIENTATION_AUTO, 0);
  next_ = 0;
}

bool VideoStore::Grab() const {
  bool good = false;
  try {
    good = video_->grab();
  } catch (const cv::Exception&) {
    good = false;
  }
  if (good) ++next_;
  return good;
}

StoredImage VideoStore::Retrieve() const {
  cv::Mat frame;
  try {
    if (!video_->retrieve(frame)) frame.release();
  } catch (const cv::Exception&) {
    frame.release();
  }
  if (frame.empty() || frame.type() != CV_8UC3) {
    throw InputError("{}: frame {} cannot be decoded", path_.string(), next_ - 1);
  }
  StoredImage image;
  image.encoding = "bgr8";
  image.size = {frame.cols, frame.rows};
  image.step = static_cast<size_t>(frame.cols) * frame.elemSize();
  image.bytes.resize(image.step * static_cast<size_t>(frame.rows));
  for (int y = 0; y < frame.rows; ++y) {
    std::copy_n(frame.ptr(y), image.step, image.bytes.data() + image.step * static_cast<size_t>(y));
  }
  return image;
}

void VideoStore::CountFrames() {
  Open();
  const double stated = video_->get(cv::CAP_PROP_FRAME_COUNT);
  size_ = {static_cast<int>(video_->get(cv::CAP_PROP_FRAME_WIDTH)),
           static_cast<int>(video_->get(cv::CAP_PROP_FRAME_HEIGHT))};
  while (Grab()) times_.push_back(video_->get(cv::CAP_PROP_POS_MSEC) * kMillisecond);
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
    if (!times_.empty() && index > 0 &&
        video_->set(cv::CAP_PROP_POS_FRAMES, static_cast<double>(index - 1)) && video_->grab()) {
      const double time = video_->get(cv::CAP_PROP_POS_MSEC) * kMillisecond;
      constexpr double kSame = 1e-6;  // s
      if (std::abs(time - times_[index - 1]) < kSame) {
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
  std::string extension = path.extension().string();
  std::ranges::transform(extension, extension.begin(), [](unsigned char c) {
    return static_cast<char>(std::tolower(c));
  });
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
