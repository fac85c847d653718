// SPDX-License-Identifier: Apache-2.0
//
// Uncertainty of projections that follows from that of the parameters.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "assess/residual_field.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// A camera is judged by what holds for this part of its image (circle).
inline constexpr double kMostOfImage = 0.9;

/// Uncertainty of the projection over the image of points at one distance.
struct ProjectionMap {
  double distance = 0;  ///< of the points from the camera, m
  ImageGrid grid;
  /// Per cell: standard deviation of the projection in its worst direction, px; NaN outside the
  /// domain of the model and the image circle.
  std::vector<double> sigma;

  /// What `kMostOfImage` of the cells keep, together with an error that is the same everywhere, px;
  /// NaN where no cell forms an image.
  [[nodiscard]] double Most(double systematic = 0) const;
};

/// An observation with the ray on which its point lies.
struct SeenRay {
  std::array<double, kMaxObservationSize> values = {};
  Ray ray;
};

/// Standard error of a camera's projection by errors of its parameters, less the rigid motion of
/// the camera frame that compensates most of them over the observed points: an error that a
/// rotation of the frame compensates belongs to every pose, not to the camera (as in mrcal).
class HousedProjection {
 public:
  /// Keeps a reference to the camera.
  HousedProjection(const CalibrationRecord& calibration, size_t camera);

  /// False without a covariance or observed points.
  [[nodiscard]] bool IsKnown() const;
  /// Rays of observations' `values`; nothing outside the domain of the model.
  [[nodiscard]] std::vector<std::optional<SeenRay>> RaysOf(
      std::span<const std::array<double, kMaxObservationSize>> values) const;
  /// In their worst directions, px, of the points at a distance (m) on rays; NaN outside the domain
  /// of the model. REQUIRES: IsKnown().
  [[nodiscard]] std::vector<double> Sigmas(std::span<const std::optional<SeenRay>> rays,
                                           double distance) const;
  /// Of the used points, ascending, m.
  [[nodiscard]] const std::vector<double>& distances() const { return distances_; }

 private:
  const CalibratedCamera& camera_;
  std::vector<double> distances_;
  Eigen::MatrixXd follow_;  // motion by the parameters, 6 x params
};

/// Maps at the nearest, the median and the farthest distance of the used points and at ten times
/// the farthest (`HousedProjection`). Empty where it is not known.
std::vector<ProjectionMap> ProjectionMaps(const CalibrationRecord& calibration, size_t camera);

}  // namespace plenocal
