// SPDX-License-Identifier: Apache-2.0
//
// A calibration's folder as what further views are chosen for.
#pragma once

#include <filesystem>

#include "assess/views/rig_knowledge.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// The calibration in the folder that `plenocal calibrate` wrote. Throws `Error` of kind kInput as
/// `OpenCalibrationFolder`, and for a calibration from a scene.
CalibrationRecord ReadTargetCalibration(const std::filesystem::path& folder);

/// `KnowledgeOf` with the micro lenses in the folder, and `SetFactors`.
RigKnowledge KnowledgeOf(const std::filesystem::path& folder,
                         const CalibrationRecord& calibration,
                         const ViewTarget& shape);

}  // namespace plenocal
