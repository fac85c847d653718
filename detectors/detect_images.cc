// SPDX-License-Identifier: Apache-2.0
#include "detectors/detect_images.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <opencv2/core.hpp>

#include "calib/error.h"
#include "calib/parallel.h"
#include "detectors/attenuation.h"
#include "detectors/detect_plenoptic.h"
#include "detectors/image.h"
#include "detectors/marker_detector.h"
#include "detectors/white_images.h"

namespace plenocal {
namespace {

struct ImageResult {
  ImageSize size{};
  MarkerDetections found;
  std::string unreadable;
};

// Detectors hold tables that are costly to build: one a thread, lent to one image at a time.
class DetectorPool {
 public:
  explicit DetectorPool(const Target& target) : target_(target) {}

  MarkerDetections Detect(const cv::Mat& gray) {
    std::unique_ptr<MarkerDetector> detector = Take();
    MarkerDetections found = detector->Detect(gray);
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(detector));
    return found;
  }

 private:
  std::unique_ptr<MarkerDetector> Take() {
    {
      const std::lock_guard lock(mutex_);
      if (!idle_.empty()) {
        auto detector = std::move(idle_.back());
        idle_.pop_back();
        return detector;
      }
    }
    return MakeMarkerDetector(target_);
  }

  const Target& target_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<MarkerDetector>> idle_;
};

/// The image as an evenly bright camera would see it; darkened as a whole where its range would not
/// do.
cv::Mat Devignetted(const cv::Mat& gray, const cv::Mat& attenuation) {
  cv::Mat exact, even;
  gray.convertTo(exact, CV_32F);
  exact /= attenuation;
  double highest = 0;
  cv::minMaxLoc(exact, nullptr, &highest);
  exact.convertTo(even, CV_8U, std::min(1.0, 255 / std::max(highest, 1.0)));
  return even;
}

/// All images of a camera together know its lens better than each alone.
void MeasureByCommonLens(const ImageSize& size, std::vector<ImageResult>* results) {
  std::vector<BentEdge> edges;
  for (const ImageResult& result : *results) {
    if (result.size != size) continue;
    edges.insert(edges.end(), result.found.edges.begin(), result.found.edges.end());
  }
  const LensCurvature lens(edges, Eigen::Vector2d(size[0], size[1]));
  for (ImageResult& result : *results) {
    for (size_t i = 0; i < result.found.bent.size(); ++i) {
      const BentMarker& bent = result.found.bent[i];
      const Eigen::Vector2d change = lens.At(bent.place) - bent.curvature;
      const Eigen::Vector2d moved = bent.by_curvature * change;
      auto& values = result.found.markers[i].values;
      values[0] += moved.x();
      values[1] += moved.y();
    }
  }
}

}  // namespace

ImageDetections DetectImages(const std::vector<FrameImage>& images,
                             const Target& target,
                             const DetectOptions& options) {
  if (options.plenoptic) return DetectPlenopticImages(images, target, options);
  // Images run in parallel; threads inside OpenCV would only compete with them.
  cv::setNumThreads(1);
  cv::Mat attenuation;
  std::vector<LeftOut> white_left_out;
  if (!options.white_images.empty()) {
    WhiteImages white = AverageWhiteImages(options.white_images, options.threads);
    CheckEvenField(white.mean);
    attenuation = SmoothAttenuation(white.mean, options.bayer);
    white_left_out = std::move(white.left_out);
  }
  std::vector<ImageResult> results(images.size());
  DetectorPool detectors(target);
  std::atomic<size_t> done{0};
  std::atomic<bool> stop{false};
  std::mutex progress_mutex;
  ParallelFor(images.size(), options.threads, [&](size_t i) {
    if (stop) return;
    ImageResult& result = results[i];
    try {
      cv::Mat gray = ReadGray(images[i].path);
      result.size = {gray.cols, gray.rows};
      if (gray.size() == attenuation.size()) gray = Devignetted(gray, attenuation);
      result.found = detectors.Detect(gray);
    } catch (const Error& error) {
      result.unreadable = error.what();
    }
    const size_t count = ++done;
    if (options.progress) {
      const std::lock_guard lock(progress_mutex);
      if (!options.progress(count)) stop = true;
    }
  });
  if (stop) throw Stopped();

  // The size of most images is the camera's; with as many of one as of another, the first seen.
  std::map<ImageSize, int> sizes;
  for (const ImageResult& result : results) {
    if (result.unreadable.empty()) ++sizes[result.size];
  }
  if (sizes.empty()) {
    throw Error(ErrorKind::kJob,
                fmt::format("no image can be read; the first: {}", results[0].unreadable));
  }
  ImageDetections detections;
  detections.left_out = std::move(white_left_out);
  int most = 0;
  for (const ImageResult& result : results) {
    if (result.unreadable.empty() && sizes[result.size] > most) {
      most = sizes[result.size];
      detections.image_size = result.size;
    }
  }

  const ImageSize white_size{attenuation.cols, attenuation.rows};
  if (!attenuation.empty() && white_size != detections.image_size) {
    throw Error(
        ErrorKind::kInput,
        fmt::format("the white images are {} x {} pixels, but the images {} x {}; record them "
                    "with the same settings of the camera",
                    white_size[0],
                    white_size[1],
                    detections.image_size[0],
                    detections.image_size[1]));
  }

  MeasureByCommonLens(detections.image_size, &results);

  for (size_t i = 0; i < images.size(); ++i) {
    ImageResult& result = results[i];
    const std::string path = images[i].path.string();
    if (!result.unreadable.empty()) {
      detections.left_out.push_back({path, WithoutPath(result.unreadable, path)});
    } else if (result.size != detections.image_size) {
      detections.left_out.push_back(
          {path,
           fmt::format("is {} x {} pixels, while the camera's images are {} x {}",
                       result.size[0],
                       result.size[1],
                       detections.image_size[0],
                       detections.image_size[1])});
    } else {
      for (const std::string& reason : result.found.left_out) {
        detections.left_out.push_back({path, reason});
      }
      if (result.found.markers.empty()) {
        detections.left_out.push_back({path, result.found.failure});
      } else {
        detections.views.push_back({images[i].frame, std::move(result.found.markers)});
      }
    }
  }
  return detections;
}

}  // namespace plenocal
