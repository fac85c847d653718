// SPDX-License-Identifier: Apache-2.0
//
// Roles of findings by their codes: what a finding explains, and what explains it.
#pragma once

#include <span>
#include <string_view>

namespace plenocal {

/// Part of a finding among the others of a calibration (`Judge`, `Diagnose`).
enum class FindingRole {
  kConsequence,  ///< a figure or a note: explains no other
  kOutlier,      ///< images or points that are left out: explains no other, but states what to do
  kImageDefect,  ///< images with worse points: explains what follows from noise
  // Causes: they explain all consequences, and have the grade of the worst.
  kCause,
  kOpenPoses,        ///< in the poses of the target, which it leaves undetermined
  kImageDistortion,  ///< in the shape of images, for which a bent target may be mistaken
  kRigCause,         ///< in the poses within a rig, for which open poses or a lens may be mistaken
  kTargetCause,      ///< in the target or its file
  kTargetResiduals,  ///< in the target as residuals show it, for which a lens may be mistaken
};

/// A code of findings with its role.
struct FindingCode {
  std::string_view code;
  FindingRole role = FindingRole::kConsequence;
  bool follows_from_noise = false;  ///< `FindingRole::kImageDefect` explains it
};

/// The entry of a code among `causes` and the codes of estimation, scene and verdict. Others are
/// consequences, those that begin with "target_" causes in the target.
FindingCode FindCode(std::string_view code, std::span<const FindingCode> causes);

}  // namespace plenocal
