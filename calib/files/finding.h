// SPDX-License-Identifier: Apache-2.0
//
// Assessment of a calibration: a grade, and findings with a stable code each (docs/diagnosis.md).
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace plenocal {

enum class Grade { kGood, kUsable, kBad };

/// The grades as files and options name them, in the order of `Grade`.
inline constexpr std::array<std::string_view, 3> kGradeNames{"good", "usable", "bad"};

inline std::string_view GradeName(Grade grade) { return kGradeNames[static_cast<size_t>(grade)]; }

/// The grade of that name, or nothing.
std::optional<Grade> ParseGrade(std::string_view name);

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

/// One defect of a calibration, or one fact that its user should read.
struct Finding {
  std::string code;  ///< stable: "noise_excess"; docs/diagnosis.md lists all
  FindingRole role = FindingRole::kConsequence;  ///< not in files
  bool follows_from_noise = false;  ///< `FindingRole::kImageDefect` explains it; not in files
  Grade grade = Grade::kGood;
  std::vector<std::string> cameras = {};       ///< names; empty: the target, the rig or all
  std::optional<double> value = std::nullopt;  ///< what was measured, in the unit of its code
  std::optional<double> limit = std::nullopt;  ///< where the grade begins
  std::string what = {};                       ///< one sentence or more
  std::string remedy = {};                     ///< what to do; empty when nothing
};

/// Moves `more` to the end of `findings`.
void Append(std::vector<Finding> more, std::vector<Finding>* findings);

struct Verdict {
  Grade grade = Grade::kGood;          ///< that of the worst finding
  std::vector<Finding> findings = {};  ///< worst first
};

}  // namespace plenocal
