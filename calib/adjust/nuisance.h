// SPDX-License-Identifier: Apache-2.0
//
// Unknowns that are common to the images of a camera and estimated beside its model's parameters.
#pragma once

#include <string_view>

#include "calib/camera/rigid_transform.h"

namespace plenocal {

struct BundleObservation;
struct ViewMotion;

/// A kind of unknown that is common to a camera. Its values follow the model's parameters in
/// `BundleCamera::params`, its prior is a `ParamRule`. Residuals, derivatives, both back ends of
/// the adjustment and the covariance take it from these functions; each may be null.
struct NuisanceKind {
  std::string_view name;  ///< of the parameter
  bool numbered = false;  ///< a camera has several: `name` is followed by _1, _2, ...
  /// Unit by which its uncertainty is judged, in standard deviations of its prior.
  double unit = 1;
  /// Adds `value` times the displacement, px, of the measured coordinates (`rows` of them) by the
  /// unknown `index` of the kind to `displacement`.
  void (*displace)(const BundleObservation& observation,
                   size_t index,
                   size_t rows,
                   double value,
                   double* displacement) = nullptr;
  /// Change of T_rig_target with the unknown at a view, in the chart of the frame's pose.
  const Vector6d& (*pose_rate)(const ViewMotion& motion) = nullptr;
};

namespace nuisances {

/// Size of a systematic displacement that all points of a camera share (`View::by_nuisance`): of a
/// plenoptic camera, errors of markers by vignetting and depth. Standard normal prior.
extern const NuisanceKind kSharedError;
/// Time, s, by which the images of a camera were taken later than their times.
extern const NuisanceKind kTimeShift;

}  // namespace nuisances
}  // namespace plenocal
