// SPDX-License-Identifier: Apache-2.0
//
// Projections of two calibrations of the same cameras from the same images, where these have
// points.
#pragma once

#include <span>

#include "calib/estimate/calibrate.h"

namespace plenocal {

/// Standard error of the projection over the whole image at the target's median distance, px: RMS
/// over the cameras (`ImageSigma`). Infinite when a parameter is not determined.
double TypicalImageSigma(const Calibration& calibration, std::span<const size_t> cameras);

/// The next two are over the supported image: the cells of a grid that have a point, or lie
/// between such cells; at two distances between which four fifths of the points lie. px, RMS over
/// these places and the cameras. Infinite where a camera images nothing of what the other does.

/// Standard error of the projection; infinite when a parameter is not determined, too.
double SupportedSigma(const Calibration& calibration, std::span<const size_t> cameras);

/// Difference between the projections of both calibrations after the best rigid motion.
double SupportedDifference(const Calibration& a,
                           const Calibration& b,
                           std::span<const size_t> cameras);

/// Difference that the standard errors of both do not explain, px: at most this in nine tenths of
/// the image (circle) at the target's median distance; the largest of the cameras.
double UnexplainedDifference(const Calibration& a,
                             const Calibration& b,
                             std::span<const size_t> cameras);

/// Covariance of image points from that of a camera's parameters, to first order.
class ImageCovariance {
 public:
  explicit ImageCovariance(const CalibratedCamera& camera);

  /// px^2. `J`: derivatives of the measured coordinates (rows) by the parameters in `support`; by
  /// all where that is empty. Infinite where a parameter that is not determined has an effect.
  [[nodiscard]] Eigen::MatrixXd Propagate(const Eigen::Ref<const Eigen::MatrixXd>& J,
                                          const std::vector<size_t>& support) const;

 private:
  Eigen::MatrixXd finite_;
  std::vector<bool> open_;  // per parameter
};

}  // namespace plenocal
