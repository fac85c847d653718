// SPDX-License-Identifier: Apache-2.0
//
// Scene points followed through the images of a calibrated rig of ordinary cameras: found by SIFT
// in the first camera, in the others along the epipolar curve, followed by optical flow, and
// measured against the image in which they were found, so that their errors do not add up along the
// track.
#pragma once

#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/camera/observation.h"

namespace plenocal {

struct FeatureOptions {
  int wanted = 1000;  ///< points followed at a time
};

/// SIFT features of an image, spread over it, with root descriptors (one row each).
struct ImageFeatures {
  std::vector<cv::Point2f> points;
  cv::Mat descriptors;
};

/// Up to `wanted` features of an 8-bit grey image: the strongest of each cell of a grid. Those
/// nearer than `apart` px to a point of `taken` are left out.
ImageFeatures FindFeatures(const cv::Mat& image,
                           int wanted,
                           std::span<const cv::Point2f> taken,
                           double apart);

/// Rows of `a` and `b` that are each other's best and clearly better than the second best (0.8).
std::vector<std::pair<int, int>> MatchDescriptors(const cv::Mat& a, const cv::Mat& b);

class FeatureTracker {
 public:
  /// `first_number`: of the first track. `cameras` must outlive this.
  FeatureTracker(const std::vector<BundleCamera>& cameras,
                 const FeatureOptions& options,
                 int first_number);

  /// The next frame: one 8-bit grey image a camera, empty where there is none.
  void AddFrame(const std::string& name, const std::vector<cv::Mat>& images);

  /// Per camera, all frames so far.
  [[nodiscard]] const std::vector<std::vector<View>>& Views() const { return views_; }
  /// Descriptors of the tracks, by number less that of the first.
  [[nodiscard]] const cv::Mat& Descriptors() const { return descriptors_; }

 private:
  // An image in which points were found, at the scales of the optical flow.
  struct KeyImage {
    cv::Mat image;
    std::vector<cv::Mat> pyramid;
  };
  struct Track {
    int number = 0;
    std::shared_ptr<const KeyImage> key;
    cv::Point2f in_key;
    std::vector<std::optional<cv::Point2f>> now;  // per camera, in the last frame
  };

  using Pyramid = std::vector<cv::Mat>;

  void Follow(size_t camera, const Pyramid& pyramid);
  void MeasureAgainstKeys(size_t camera, const Pyramid& pyramid);
  void DropLost();
  void FindNew(const std::vector<cv::Mat>& images, const std::vector<Pyramid>& pyramids);
  void FindInOthers(size_t first_track,
                    const std::vector<cv::Mat>& images,
                    const std::vector<Pyramid>& pyramids);

  const std::vector<BundleCamera>& cameras_;
  FeatureOptions options_;
  int first_number_, next_number_;
  std::vector<Track> tracks_;
  std::vector<Pyramid> last_;  // per camera
  std::vector<std::vector<View>> views_;
  cv::Mat descriptors_;
};

}  // namespace plenocal
