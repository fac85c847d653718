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

/// One defect of a calibration, or one fact that its user should read.
struct Finding {
  std::string code;  ///< stable: "noise_excess"; docs/diagnosis.md lists all
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
