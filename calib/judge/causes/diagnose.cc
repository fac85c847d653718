// SPDX-License-Identifier: Apache-2.0
#include "calib/judge/causes/diagnose.h"

#include <algorithm>

#include "calib/judge/causes/lens_causes.h"
#include "calib/judge/causes/recording_causes.h"
#include "calib/judge/causes/rig_causes.h"
#include "calib/judge/verdict.h"

namespace plenocal {
namespace {

// Whether the residuals of a camera are larger than its noise, without a known cause.
bool IsUnexplained(const Verdict& verdict, const std::string& camera) {
  return std::ranges::any_of(verdict.findings, [&](const Finding& finding) {
    const bool is_symptom = finding.code == "residual_pattern" || finding.code == "noise_excess";
    return is_symptom && finding.grade != Grade::kGood &&
           std::ranges::find(finding.cameras, camera) != finding.cameras.end();
  });
}

bool IsTargetWrong(const std::vector<Finding>& findings) {
  return std::ranges::any_of(findings, [](const Finding& finding) {
    return finding.grade != Grade::kGood && finding.code.starts_with("target_");
  });
}

}  // namespace

void Diagnose(const CalibrationInput& input,
              const Calibration& calibration,
              std::span<const CameraModel> models,
              CalibrationRecord* record) {
  Append(FindRigCauses(calibration), &record->findings);
  Append(FindRepeatedImages(calibration), &record->findings);
  // A wrong target has residuals of any shape, which look like those of other causes.
  if (IsTargetWrong(record->findings)) {
    record->verdict = Judge(*record);
    return;
  }
  Append(FindRecordingCauses(calibration), &record->findings);
  record->verdict = Judge(*record);
  for (size_t c = 0; c < input.cameras.size(); ++c) {
    const std::string& name = input.cameras[c].name;
    if (!IsUnexplained(*record->verdict, name)) continue;
    std::vector<Finding> found = FindLensCauses(input, c, models);
    // It names the model as well, which the estimation's own finding does not.
    if (!found.empty()) {
      std::erase_if(record->findings, [&](const Finding& finding) {
        return finding.code == "model_misfit" && finding.cameras == std::vector{name};
      });
    }
    Append(std::move(found), &record->findings);
  }
  record->verdict = Judge(*record);
}

}  // namespace plenocal
