// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/detect_images.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <opencv2/core.hpp>
#include <optional>

#include "calib/base/format_error.h"
#include "calib/base/parallel.h"
#include "calib/camera/observation_entry.h"
#include "calib/io/detection_cache.h"
#include "detectors/images/attenuation.h"
#include "detectors/images/detector_pool.h"
#include "detectors/images/image.h"
#include "detectors/images/image_circle.h"
#include "detectors/images/opencv_threads.h"
#include "detectors/images/pictures.h"
#include "detectors/images/target_area.h"
#include "detectors/images/white_images.h"

namespace plenocal {

template <MaybeConst<DistortionMeasurement> T>
auto EntryMembers(T& measurement) {
  return std::tie(measurement.p, measurement.along, measurement.value, measurement.variance);
}

template <MaybeConst<SensitivityPiece> T>
auto EntryMembers(T& piece) {
  return std::tie(piece.p, piece.assumed, piece.by_distortion);
}

template <MaybeConst<DistortionSensitivity> T>
auto EntryMembers(T& sensitivity) {
  return std::tie(sensitivity.pieces, sensitivity.sigma);
}

template <MaybeConst<MarkerDetections> T>
auto EntryMembers(T& found) {
  return std::tie(found.markers,
                  found.left_out,
                  found.failure,
                  found.measurements,
                  found.sensitivities,
                  found.layout,
                  found.layout_evidence,
                  found.by_layout);
}

namespace {

struct ImageResult {
  ImageSize size{};
  MarkerDetections found;
  ImageTraits traits;
  std::vector<std::uint8_t> levels;  // of `ImageCircleFit`
  std::string unreadable;
  bool reused = false;
};

template <MaybeConst<ImageResult> T>
auto EntryMembers(T& result) {
  return std::tie(result.size,
                  result.traits.orientation,
                  result.traits.blur,
                  result.traits.saturated,
                  result.levels,
                  result.found);
}

/// Lens fall-off of an ordinary camera, from its white images.
struct WhiteField {
  cv::Mat attenuation;  ///< empty: there are no white images
  std::vector<LeftOut> left_out;
};

WhiteField MeasureWhiteField(const DetectOptions& options) {
  if (options.white_images.empty()) return {};
  WhiteImages white = AverageWhiteImages(options.white_images, options.threads);
  CheckEvenField(white.mean);
  return {SmoothAttenuation(white.mean, options.bayer), std::move(white.left_out)};
}

/// The image as an evenly bright camera would record it; darkened as a whole where its range would
/// not suffice.
cv::Mat Devignetted(const cv::Mat& gray, const cv::Mat& attenuation) {
  cv::Mat exact, even;
  gray.convertTo(exact, CV_32F);
  exact /= attenuation;
  double highest = 0;
  cv::minMaxLoc(exact, nullptr, &highest);
  exact.convertTo(even, CV_8U, std::min(1.0, 255 / std::max(highest, 1.0)));
  return even;
}

/// An image without vignetting where that is known.
cv::Mat Even(const cv::Mat& gray, const cv::Mat& attenuation) {
  return gray.size() == attenuation.size() ? Devignetted(gray, attenuation) : gray;
}

/// What an image shows before all images have decided the board's layout.
const MarkerDetections& Shown(const MarkerDetections& found) {
  return found.by_layout.empty() ? found : found.by_layout.front();
}

/// The images of one camera and what they share.
class ImageRun {
 public:
  ImageRun(const std::vector<FrameImage>& images,
           const MarkerDetectorFactory& make_detector,
           const DetectOptions& options)
      : images_(images),
        options_(options),
        cache_(options.cache != nullptr ? *options.cache : none_),
        white_(MeasureWhiteField(options)),
        white_key_(internal::WhiteKey(options)),
        detectors_(make_detector),
        results_(images.size()) {}

  /// Calls then(i) after each image, from several threads. Throws `Stopped`.
  void DetectAll(const std::function<void(size_t)>& then = {});
  std::vector<ImageSketch> Sketch();
  ImageDetections Collect();

 private:
  [[nodiscard]] ImageReport ReportOf(size_t i) const;
  /// Detects the markers of an image, or finds them in the cache. Returns its picture where that is
  /// asked for.
  std::string Detect(const FrameImage& image, ImageResult* result);
  /// The size of most images; with as many of one as of another, the first seen.
  [[nodiscard]] ImageSize CommonSize() const;
  void CheckWhiteImageSize(const ImageSize& size) const;
  /// Decides the board's layout by all images: images that fit both take it, images of another are
  /// left out.
  void SettleLayout();
  /// Measures all markers again by the distortion that all images of the camera show together.
  void UseCommonDistortion(const ImageSize& size);
  /// The result of image number i.
  void Collect(size_t i, ImageDetections* detections);
  [[nodiscard]] SampleView Sample(const ImageDetections& detections) const;

  const std::vector<FrameImage>& images_;
  const DetectOptions& options_;
  DetectionCache none_{{}, {}, true};
  DetectionCache& cache_;
  WhiteField white_;
  std::string white_key_;
  DetectorPool detectors_;
  std::vector<ImageResult> results_;
};

std::string ImageRun::Detect(const FrameImage& image, ImageResult* result) {
  ImageContent content(image);
  const std::string key = cache_.Key({"markers", white_key_, content.Hash()});
  if (auto known = LoadEntry<ImageResult>(cache_, key)) {
    *result = std::move(*known);
    result->reused = true;
  }
  if (result->reused && !options_.keep) return {};
  const cv::Mat recorded = content.Gray();
  const cv::Mat gray = Even(recorded, white_.attenuation);
  result->size = {gray.cols, gray.rows};
  if (!result->reused) {
    result->found = detectors_.Detect(gray);
    const internal::TargetArea area =
        internal::MeasureTargetArea(recorded, Shown(result->found).markers);
    result->traits = {content.Orientation(), area.blur, area.saturated};
    result->levels = internal::CellLevels(recorded);
    cache_.Save(key, PackEntry(*result));
  }
  if (!options_.keep) return {};
  return EncodeImage(".png", internal::MarkerPicture(gray, result->found.markers));
}

void ImageRun::DetectAll(const std::function<void(size_t)>& then) {
  std::atomic<size_t> done{0};
  std::atomic<bool> stop{false};
  std::mutex progress_mutex;
  ParallelFor(images_.size(), options_.threads, [&](size_t i) {
    if (stop) return;
    std::string picture;
    try {
      picture = Detect(images_[i], &results_[i]);
    } catch (const Error& error) {
      results_[i].unreadable = error.what();
    }
    if (!picture.empty()) options_.keep(images_[i].frame + ".png", picture);
    const size_t count = ++done;
    const ImageReport report = ReportOf(i);
    if (then) then(i);
    const std::lock_guard lock(progress_mutex);
    if (options_.report) {
      options_.report(report);
    }
    if (options_.progress) {
      if (!options_.progress(count)) stop = true;
    }
  });
  if (stop) throw Stopped();
}

ImageSize ImageRun::CommonSize() const {
  std::map<ImageSize, int> sizes;
  for (const ImageResult& result : results_) {
    if (result.unreadable.empty()) ++sizes[result.size];
  }
  if (sizes.empty()) {
    throw JobError("no image can be read; the first: {}", results_[0].unreadable);
  }
  ImageSize common{};
  int most = 0;
  for (const ImageResult& result : results_) {
    if (result.unreadable.empty() && sizes[result.size] > most) {
      most = sizes[result.size];
      common = result.size;
    }
  }
  return common;
}

void ImageRun::CheckWhiteImageSize(const ImageSize& size) const {
  const ImageSize white_size{white_.attenuation.cols, white_.attenuation.rows};
  if (white_.attenuation.empty() || white_size == size) return;
  throw InputError(
      "the white images are {} x {} pixels, but the images {} x {}; record "
      "them with the same settings of the camera",
      white_size[0],
      white_size[1],
      size[0],
      size[1]);
}

void ImageRun::SettleLayout() {
  std::map<std::string, int> evidence;
  for (const ImageResult& result : results_) {
    if (result.found.layout_evidence > 0) {
      evidence[result.found.layout] += result.found.layout_evidence;
    }
  }
  if (evidence.empty()) return;
  const auto by_evidence = [](const auto& a, const auto& b) { return a.second < b.second; };
  const std::string& layout = std::ranges::max_element(evidence, by_evidence)->first;
  for (ImageResult& result : results_) {
    MarkerDetections& found = result.found;
    if (found.layout_evidence > 0 && found.layout != layout) {
      const std::string shown = std::move(found.layout);
      found = {};
      found.failure = fmt::format(
          "shows the {} of OpenCV's ChArUco boards, while the camera's images together show the "
          "{}; leave out images of another board, or state legacy: true or false in the target file",
          shown,
          layout);
    }
    std::vector<MarkerDetections> by_layout = std::move(found.by_layout);
    for (MarkerDetections& each : by_layout) {
      if (each.layout == layout) found = std::move(each);
    }
  }
}

void ImageRun::UseCommonDistortion(const ImageSize& size) {
  std::vector<DistortionMeasurement> measurements;
  for (const ImageResult& result : results_) {
    if (result.size != size) continue;
    const std::vector<DistortionMeasurement>& of_image = result.found.measurements;
    measurements.insert(measurements.end(), of_image.begin(), of_image.end());
  }
  const DistortionField field(measurements);
  for (ImageResult& result : results_) {
    for (size_t i = 0; i < result.found.sensitivities.size(); ++i) {
      const DistortionSensitivity& sensitivity = result.found.sensitivities[i];
      const Eigen::Vector2d change = field.Change(sensitivity);
      Observation& marker = result.found.markers[i];
      marker.values[0] += change.x();
      marker.values[1] += change.y();
      marker.detector_sigma = field.Sigma(sensitivity);
    }
  }
}

void ImageRun::Collect(size_t i, ImageDetections* detections) {
  ImageResult& result = results_[i];
  const std::string path = images_[i].path.string();
  const auto leave_out = [&](const std::string& reason) {
    detections->left_out.push_back({path, reason, true});
  };
  if (result.reused) ++detections->reused;
  if (!result.unreadable.empty()) {
    leave_out(WithoutPath(result.unreadable, path));
    return;
  }
  if (result.size != detections->image_size) {
    leave_out(fmt::format("is {} x {} pixels, while the camera's images are {} x {}",
                          result.size[0],
                          result.size[1],
                          detections->image_size[0],
                          detections->image_size[1]));
    return;
  }
  detections->traits[images_[i].frame] = result.traits;
  for (const std::string& reason : result.found.left_out) {
    detections->left_out.push_back({path, reason});
  }
  if (result.found.markers.empty()) {
    leave_out(result.found.failure);
  } else {
    detections->views.push_back({images_[i].frame, std::move(result.found.markers)});
  }
}

SampleView ImageRun::Sample(const ImageDetections& detections) const {
  const auto fewer = [](const View& a, const View& b) {
    return a.observations.size() < b.observations.size();
  };
  const auto view = std::max_element(detections.views.begin(), detections.views.end(), fewer);
  if (view == detections.views.end()) return {};
  const auto image = std::find_if(images_.begin(), images_.end(), [&](const FrameImage& of) {
    return of.frame == view->frame;
  });
  const cv::Mat gray = Even(ReadGray(*image), white_.attenuation);
  return {view->frame, internal::SamplePicture(gray, view->observations), {}};
}

ImageReport ImageRun::ReportOf(size_t i) const {
  const ImageResult& result = results_[i];
  const MarkerDetections& found = Shown(result.found);
  return {images_[i].frame,
          found.markers.size(),
          result.unreadable.empty() ? found.failure : result.unreadable};
}

std::vector<ImageSketch> ImageRun::Sketch() {
  DetectAll([&](size_t i) {  // drops what sketches do not have: there may be very many
    MarkerDetections& found = results_[i].found;
    found.markers.shrink_to_fit();
    found.left_out = {};
    found.measurements = {};
    found.sensitivities = {};
  });
  SettleLayout();
  std::vector<ImageSketch> sketches;
  for (ImageResult& result : results_) {
    sketches.push_back(
        {.size = result.size,
         .points = std::move(result.found.markers),
         .blur = result.traits.blur,
         .why = result.unreadable.empty() ? result.found.failure : result.unreadable});
  }
  return sketches;
}

ImageDetections ImageRun::Collect() {
  ImageDetections detections;
  detections.image_size = CommonSize();
  CheckWhiteImageSize(detections.image_size);
  if (!white_.attenuation.empty()) {
    detections.vignetting = EncodeImage(".tiff", white_.attenuation);
  }
  SettleLayout();
  UseCommonDistortion(detections.image_size);
  detections.left_out = std::move(white_.left_out);
  internal::ImageCircleFit circle(detections.image_size);
  for (size_t i = 0; i < images_.size(); ++i) {
    if (results_[i].size == detections.image_size) circle.Add(results_[i].levels);
    Collect(i, &detections);
  }
  detections.image_circle = circle.Fit();
  detections.sample = Sample(detections);
  return detections;
}

}  // namespace

std::string internal::WhiteKey(const DetectOptions& options) {
  std::string key = options.bayer ? std::string(BayerName(*options.bayer)) : "plain";
  for (const FrameImage& image : options.white_images) {
    key += '\n';
    key += HashImage(image);
  }
  return key;
}

std::vector<ImageSketch> SketchOrdinaryImages(const std::vector<FrameImage>& images,
                                              const MarkerDetectorFactory& make_detector,
                                              const DetectOptions& options) {
  UseNoOpenCvThreads();
  return ImageRun(images, make_detector, options).Sketch();
}

ImageDetections DetectOrdinaryImages(const std::vector<FrameImage>& images,
                                     const MarkerDetectorFactory& make_detector,
                                     const DetectOptions& options) {
  UseNoOpenCvThreads();
  ImageRun run(images, make_detector, options);
  run.DetectAll();
  return run.Collect();
}

}  // namespace plenocal
