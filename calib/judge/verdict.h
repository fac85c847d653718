// SPDX-License-Identifier: Apache-2.0
//
// Assessment of a calibration: a grade, and findings with a stable code each (docs/diagnosis.md).
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace plenocal {

enum class Grade { kGood, kUsable, kBad };

/// "good", "usable" or "bad", as in files and options.
std::string_view GradeName(Grade grade);

/// One defect of a calibration, or one fact that its user should read.
struct Finding {
  std::string code;  ///< stable: "noise_excess"; docs/diagnosis.md lists all
  Grade grade = Grade::kGood;
  std::vector<std::string> cameras;  ///< names; empty: the target, the rig or all
  std::optional<double> value;       ///< what was measured, in the unit that docs/diagnosis.md states
  std::optional<double> limit;       ///< the value at which the grade begins
  std::string what;                  ///< one sentence or more
  std::string remedy;                ///< what to do; empty when nothing
};

struct Verdict {
  Grade grade = Grade::kGood;     ///< that of the worst finding
  std::vector<Finding> findings;  ///< worst first
};

}  // namespace plenocal
