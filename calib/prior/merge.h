// SPDX-License-Identifier: Apache-2.0
//
// Several calibrations of one rig as one: days, or subsets of its cameras.
#pragma once

#include <cmath>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// Distance of one calibration from the merged one in one unknown.
struct MergeDeviation {
  size_t calibration = 0;  ///< index into those that were merged
  size_t camera = 0;       ///< index into the cameras of the merged one
  std::optional<size_t> param = {};
  /// For extrinsics: the camera in whose frame this calibration has them, and the component in the
  /// chart (`Retract`).
  size_t master = 0;
  int component = 0;
  double deviation = 0;  ///< of this calibration from the merged one; m or rad of extrinsics
  double sigma = 0;      ///< of `deviation` if all calibrations are of one rig; 0: it is no test

  [[nodiscard]] double InSigmas() const { return sigma > 0 ? std::abs(deviation) / sigma : 0; }
};

/// Extrinsics of a camera that moved on the rig, in one calibration.
struct MovedExtrinsics {
  size_t calibration = 0, camera = 0;  ///< as in `MergeDeviation`
  RigidTransform T_camera_rig;
  Vector6d sigma_xi = Vector6d::Zero();  ///< of its se(3) vector
};

struct MergedCalibrations {
  /// Cameras in the order in which the calibrations have them first; its rig is the first camera.
  /// Standard errors are those of the calibrations together, times `scale`. Cameras that moved
  /// stand where the last calibration with their place has them.
  CalibrationRecord record;
  std::vector<MovedExtrinsics> mounts;     ///< of cameras that moved, by camera
  std::vector<MergeDeviation> deviations;  ///< by calibration, then camera
  double chi_square = 0;                   ///< of all deviations
  int degrees = 0;                         ///< of freedom of it; 0: nothing is in two calibrations
  /// 1 where the calibrations agree, else sqrt(chi_square / degrees): standard errors that are as
  /// large as the calibrations differ (Birge's ratio).
  double scale = 1;
};

struct MergeOptions {
  /// Cameras that moved on the rig between the calibrations: each has a place of their own.
  std::vector<std::string> moved = {};
};

/// The parameters and extrinsics that fit several independent calibrations best, each with its
/// covariance (generalised least squares, by Gauss and Newton). Cameras are the same by their
/// names. Throws `Error`: of kind kInput for one without standard errors, cameras of different
/// models, sizes, constants or fixed parameters, cameras whose mutual pose follows from none, and
/// unknown names in `options`; of kind kJob where no camera can have the result.
/// REQUIRES: at least one; `correlations` of each are set where there are any.
MergedCalibrations MergeCalibrations(std::span<const CalibrationRecord> calibrations,
                                     const MergeOptions& options);

/// "left.f_x", or "right.T_right_left.x" of the extrinsics of `right` with respect to `left`.
std::string NameOfDeviation(const MergedCalibrations& merged, const MergeDeviation& deviation);
/// "0.4 px", "-0.2 mm".
std::string SizeOfDeviation(const MergedCalibrations& merged, const MergeDeviation& deviation);

/// The explanation where `merged` disagrees by more than standard errors explain (chi-square of all
/// deviations): finding `mount_moved` where places of its own for one camera do, else
/// `calibrations_disagree` with the farthest unknowns. Nothing where they agree.
std::vector<Finding> FindingsOfMerge(const MergedCalibrations& merged,
                                     std::span<const CalibrationRecord> calibrations,
                                     const MergeOptions& options);

}  // namespace plenocal
