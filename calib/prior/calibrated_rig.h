// SPDX-License-Identifier: Apache-2.0
//
// Cameras of an earlier calibration in an adjustment over scene points.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// Cameras of an earlier calibration with what it determines.
struct CalibratedRig {
  std::vector<BundleCamera> cameras;  ///< the first is the rig's master
  /// Nothing when the calibration states no standard errors: all is fixed then.
  std::optional<CalibrationPrior> prior;
};

/// The cameras of these names (empty: all), in this order; the first one's frame becomes the rig's.
/// Parameters and extrinsics with a standard error are estimated, with their joint covariance as
/// prior; those with none, and those that the calibration leaves open, are fixed.
/// `with_nuisances`: the cameras have the sizes of common displacements that the calibration
/// states, too, as unknowns of the prior; else the prior is the marginal one of the rest. Throws
/// `Error` of kind kInput for an unknown name.
CalibratedRig MakeCalibratedRig(const CalibrationRecord& calibration,
                                std::span<const std::string> names,
                                bool with_nuisances = false);

/// Standard errors that were scaled for errors which the points of a frame share, in some cameras
/// and with the correlations as they were, would make the well known combinations of several
/// cameras' unknowns wrong: all get the largest factor. `prior` is that of `names` in `record`.
void ScaleAlike(const CalibrationRecord& record,
                const std::vector<std::string>& names,
                CalibrationPrior* prior);

/// Derivatives of the chart of T_camera_master by those of T_camera_rig and T_master_rig.
struct RelativeChart {
  Matrix6d by_camera = Matrix6d::Identity(), by_master = Matrix6d::Zero();
};

RelativeChart ChartOfRelative(const RigidTransform& T_camera_rig,
                              const RigidTransform& T_master_rig);

}  // namespace plenocal
