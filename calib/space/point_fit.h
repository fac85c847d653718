// SPDX-License-Identifier: Apache-2.0
//
// Points in space by maximum likelihood from the places at which calibrated cameras see them.
#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/camera/observation.h"
#include "calib/space/space_rig.h"

namespace plenocal {

/// The point with the smallest sum of squared distances from rays: a start, no estimate.
struct NearestPoint {
  Eigen::Vector3d position;
  double spread = 0;  ///< about the squared sine of the parallax
};
/// Nothing for parallel rays.
std::optional<NearestPoint> NearestToRays(std::span<const Ray> rays);

/// One measurement of a point.
struct SpaceObservation {
  size_t camera = 0;
  std::array<double, kMaxObservationSize> values{};  ///< as `Observation::values`
  double sigma = 0;  ///< of each measured coordinate, without the part common to a marker, px
  std::vector<double> by_shared = {};  ///< one of `View::by_nuisance`, or empty
};

/// The frame in which an error of the calibration moves points.
enum class SpaceFrame {
  kRig,      ///< that of the first camera, as calibrated
  kHousing,  ///< the one that the calibration's own points hold: what a rigid motion of all does
             ///< not change
};

/// A point X = o + m / rho in the rig's frame, |m| = 1; rho = 0 lies at infinity, below it nothing.
struct SpacePoint {
  std::string reason;                               ///< why there is none; else empty
  Eigen::Vector3d o{0, 0, 0}, m{0, 0, 1};           ///< m, 1
  double rho = 0;                                   ///< 1 / m
  Eigen::Vector3d position{0, 0, 0};                ///< X, m; infinite where rho <= 0
  double sigma_rho = 0;                             ///< 1 / m, by noise and calibration
  Eigen::Matrix3d noise = Eigen::Matrix3d::Zero();  ///< covariance of X by noise, m^2
  /// Root of the covariance of X that points share, m: rows x, y, z, columns as `SpaceRig::root`.
  /// Two points' common covariance is the product of their roots. The last `frame_columns` columns
  /// (jitter) are common to points of one frame alone, the others to all of the calibration.
  Eigen::MatrixXd shared;
  Eigen::Index frame_columns = 0;
  int observations = 0;
  double rms = 0;         ///< of the residual vector's length, px
  double chi_square = 0;  ///< of the residuals, by noise and calibration
  int degrees = 0;
  double probability = 1;  ///< of a larger one
  /// Residuals less what the point absorbs, in units of their noise, and their derivative by the
  /// columns of `shared`: what `CommonErrors` sums.
  Eigen::VectorXd misses;
  Eigen::MatrixXd misses_by_calibration;

  [[nodiscard]] bool IsFound() const { return reason.empty(); }
  [[nodiscard]] Eigen::Matrix3d Covariance() const { return noise + shared * shared.transpose(); }
  [[nodiscard]] auto ByCalibration() const {
    return shared.leftCols(shared.cols() - frame_columns);
  }
  [[nodiscard]] auto ByFrame() const { return shared.rightCols(frame_columns); }
};

/// The point that all observations see. A start by least squares of the distances from the rays is
/// improved until it is the maximum of the likelihood, through infinity where all models allow it.
SpacePoint FitPoint(const SpaceRig& rig,
                    std::span<const SpaceObservation> seen,
                    SpaceFrame frame = SpaceFrame::kRig);

/// What measurements of a point leave uncertain.
struct PointError {
  Eigen::Matrix3d noise;     ///< covariance of X by their noise, m^2
  Eigen::MatrixXd by_theta;  ///< derivative of X, 3 x theta
};

/// Of the point X, m, of the rig's frame. `seen`: cameras in their order, contexts and sigmas; the
/// measured places are not used. `z_is_known`: one ordinary camera measures x and y alone. Nothing
/// outside a model's domain and where the rays do not determine the point. REQUIRES: the rig has
/// `follow` for `SpaceFrame::kHousing`.
std::optional<PointError> ErrorAt(const SpaceRig& rig,
                                  std::span<const SpaceObservation> seen,
                                  const Eigen::Vector3d& X,
                                  SpaceFrame frame,
                                  bool z_is_known = false);

/// The interval of a distance 1 / rho, m: symmetric in rho, since the distance of a far point has
/// neither mean nor variance. The upper end is infinite where rho is not above `sigmas` of its
/// standard error.
struct DistanceInterval {
  double nearest = 0, farthest = std::numeric_limits<double>::infinity();
};
DistanceInterval DistanceOf(const SpacePoint& point, double sigmas);

}  // namespace plenocal
