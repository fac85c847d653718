// SPDX-License-Identifier: Apache-2.0
//
// Assessment of a calibration in plain words.
#pragma once

#include <string>
#include <vector>

#include "apps/report/precision.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

enum class Grade { kGood, kWeak, kBad };

struct Finding {
  Grade grade = Grade::kGood;
  std::string what;    ///< one sentence or more
  std::string remedy;  ///< what to do; empty when nothing
};

struct Verdict {
  Grade grade = Grade::kGood;  ///< that of the worst finding
  std::string headline;
  std::vector<Finding> findings;  ///< worst first
};

/// `maps`: those of each camera.
Verdict Judge(const CalibrationRecord& calibration,
              const std::vector<std::vector<ProjectionMap>>& maps);

}  // namespace plenocal
