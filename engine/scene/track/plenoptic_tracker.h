// SPDX-License-Identifier: Apache-2.0
//
// Scene points followed through the raw images of a plenoptic camera: in the totally focused
// images as an ordinary camera's, and measured in the micro images of each raw image.
#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera/bayer.h"
#include "calib/files/frame_images.h"
#include "detectors/plenoptic/depth/reconstruction.h"
#include "detectors/plenoptic/markers/marker_measurement.h"
#include "engine/scene/track/feature_tracker.h"

namespace plenocal {

/// Micro lenses and attenuation of a camera from its white images; those that cannot be used go to
/// `left_out`. Throws `Error`.
PlenopticCamera MeasurePlenopticCamera(const std::vector<FrameImage>& white_images,
                                       std::optional<BayerOrder> bayer,
                                       int threads,
                                       std::vector<LeftOut>* left_out);

class PlenopticTracker {
 public:
  /// `camera` must outlive this. `first_number`: of the first track.
  PlenopticTracker(const BundleCamera& camera,
                   const PlenopticCamera& optics,
                   const FeatureOptions& options,
                   int first_number,
                   int threads);

  /// Throws `Error` for a raw image that cannot be reconstructed (`Reconstruct`); the frame then
  /// counts as one without an image.
  void AddFrame(const std::string& name, const cv::Mat& raw);

  /// All frames so far: x, y, lens_x, lens_y of each point in the micro images, corrected by what
  /// all of them show of vignetting and depth.
  [[nodiscard]] std::vector<View> Views() const;
  /// In the totally focused images, px of them.
  [[nodiscard]] std::vector<View> FocusedViews() const { return tracker_.Views()[0]; }
  [[nodiscard]] const cv::Mat& Descriptors() const { return tracker_.Descriptors(); }

 private:
  const PlenopticCamera& optics_;
  std::vector<BundleCamera> camera_;
  FeatureTracker tracker_;
  int threads_;
  std::optional<double> brightness_;  // factor to 8 bits: that of the first image, for all
  std::vector<std::string> frames_;
  std::vector<internal::RawMeasurements> measured_;  // parallel to frames_
};

/// The totally focused image of a raw image with 8 bits.
cv::Mat FocusedImage(const cv::Mat& raw, const PlenopticCamera& optics, int threads);

}  // namespace plenocal
