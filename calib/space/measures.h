// SPDX-License-Identifier: Apache-2.0
//
// Lengths, angles and planes of points in space with standard errors: the noise of each point is
// its own, the calibration's error is common to all.
#pragma once

#include <span>

#include "calib/space/point_fit.h"

namespace plenocal {

struct Measured {
  double value = 0;        ///< m or rad
  double noise = 0;        ///< standard errors: by the points' noise,
  double calibration = 0;  ///< by the calibration,
  double jitter = 0;       ///< by cameras that do not expose at once
  double bias = 0;         ///< that errors add to a length in the mean; in `value`

  [[nodiscard]] double Sigma() const;
};

/// Distance of two points, m. REQUIRES (as below): they are found, and not at infinity.
Measured LengthOf(const SpacePoint& a, const SpacePoint& b);
/// Angle at b between the directions to a and c, rad.
Measured AngleOf(const SpacePoint& a, const SpacePoint& b, const SpacePoint& c);

/// The mean of points as one: its position, noise and shared error. REQUIRES: as above, not empty.
SpacePoint MeanOf(std::span<const SpacePoint* const> points);

/// The plane n . X = h of generalised least squares, by the points' whole covariance.
struct MeasuredPlane {
  Eigen::Vector3d normal{0, 0, 1};  ///< |n| = 1, towards the rig's origin
  double offset = 0;                ///< h, m
  double rms = 0;                   ///< of the points' distances from it, m
  double chi_square = 0;            ///< of these by their covariance
  int degrees = 0;                  ///< n - 3
  double probability = 1;           ///< of a larger chi-square
};
/// Nothing (`degrees` < 0) for fewer than three points, or points on a line.
MeasuredPlane PlaneOf(std::span<const SpacePoint* const> points);

}  // namespace plenocal
