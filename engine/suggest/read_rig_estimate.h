// SPDX-License-Identifier: Apache-2.0
//
// The estimate of a rig from the folder of a calibration.
#pragma once

#include <filesystem>

#include "assess/views/rig_estimate.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// The calibration in the folder that `plenocal calibrate` wrote. Throws `Error` of kind kInput as
/// `OpenCalibrationFolder`, and for a calibration from a scene.
CalibrationRecord ReadTargetCalibration(const std::filesystem::path& folder);

/// `MakeRigEstimate` with the micro lenses in the folder, and `SetFactors`.
RigEstimate MakeRigEstimate(const std::filesystem::path& folder,
                            const CalibrationRecord& calibration,
                            const ViewTarget& shape);

}  // namespace plenocal
