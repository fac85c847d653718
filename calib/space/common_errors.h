// SPDX-License-Identifier: Apache-2.0
//
// The error of the calibration that all points share: whether their rays show more of it than
// stated, and its best estimate from them.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "calib/space/point_fit.h"

namespace plenocal {

/// Whether rays meet, given the errors of the calibration that points share: single points may each
/// meet while all show the same error.
struct RaysTest {
  double chi_square = 0;
  int degrees = 0;
  double probability = 1;
};

/// z = B u + noise of unit variance over all points: `misses`, `misses_by_calibration`, and the
/// errors u ~ N(0, I) in the columns of `SpaceRig::root`.
class CommonErrors {
 public:
  CommonErrors() = default;
  /// Of the points of one frame, which has its last `frame_columns` errors for itself.
  explicit CommonErrors(std::span<const SpacePoint> frame);
  void Add(const CommonErrors& other);

  [[nodiscard]] RaysTest Test() const;
  /// u of the largest probability, where the points were fitted at u = `at`.
  [[nodiscard]] Eigen::VectorXd Estimate(const Eigen::VectorXd& at) const;
  /// Root of the covariance of u that the points leave.
  [[nodiscard]] Eigen::MatrixXd Root() const;

 private:
  [[nodiscard]] Eigen::MatrixXd Information() const;

  Eigen::MatrixXd normal_;  // B' B
  Eigen::VectorXd mixed_;   // B' z
  double square_ = 0;       // z' z
  int degrees_ = 0;
};

struct AdjustedRig {
  SpaceRig rig;            ///< its root is that of the covariance which the points leave
  Eigen::VectorXd change;  ///< of theta
};
/// The rig whose theta is most probable, given its prior and the rays of all points. REQUIRES: no
/// jitter.
AdjustedRig AdjustedTo(const SpaceRig& rig,
                       std::span<const std::vector<SpaceObservation>> points,
                       int threads);

}  // namespace plenocal
