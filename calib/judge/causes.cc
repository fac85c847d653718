// SPDX-License-Identifier: Apache-2.0
#include "calib/judge/causes.h"

#include <iterator>

#include "calib/judge/recording_causes.h"
#include "calib/judge/rig_causes.h"

namespace plenocal {

std::vector<Finding> FindCauses(const Calibration& calibration) {
  std::vector<Finding> findings = FindRigCauses(calibration);
  std::vector<Finding> of_recording = FindRecordingCauses(calibration);
  findings.insert(findings.end(),
                  std::make_move_iterator(of_recording.begin()),
                  std::make_move_iterator(of_recording.end()));
  return findings;
}

}  // namespace plenocal
