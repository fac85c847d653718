// SPDX-License-Identifier: Apache-2.0
//
// Roles of findings by their codes: which findings explain which others.
#pragma once

#include <span>
#include <string_view>

namespace plenocal {

/// Relation of a finding to the other findings of a calibration (`Judge`, `Diagnose`).
enum class FindingRole {
  kConsequence,  ///< a figure or a note: explains no other finding
  kOutlier,      ///< images or points to leave out: explains no other, but has a remedy
  kImageDefect,  ///< images with less exact points: explains findings that follow from noise
  // Causes: they explain all consequences and have the grade of the worst one.
  kCause,
  kOpenPoses,        ///< poses of the target that do not determine the parameters
  kImageDistortion,  ///< deformed images (rolling shutter); a bent target has similar residuals
  kRigCause,         ///< poses within a rig; open poses or a wrong lens model have similar effects
  kTargetCause,      ///< the target or its file
  kTargetResiduals,  ///< the target, by residuals that a wrong lens model can have too
};

/// A code of findings with its role.
struct FindingCode {
  std::string_view code;
  FindingRole role = FindingRole::kConsequence;
  bool follows_from_noise = false;  ///< `FindingRole::kImageDefect` explains it
};

/// The entry of a code in `causes` or among the codes of estimation, scene and verdict. Any other
/// code is a cause in the target if it begins with "target_", else a consequence.
FindingCode FindCode(std::string_view code, std::span<const FindingCode> causes);

}  // namespace plenocal
