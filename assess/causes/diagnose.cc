// SPDX-License-Identifier: Apache-2.0
#include "assess/causes/diagnose.h"

#include <algorithm>
#include <array>
#include <map>
#include <optional>
#include <string_view>
#include <utility>

#include "assess/causes/image_causes.h"
#include "assess/causes/lens_causes.h"
#include "assess/causes/outlier_causes.h"
#include "assess/causes/recording_causes.h"
#include "assess/causes/rig_causes.h"
#include "assess/target/flatness.h"
#include "assess/target/frame_choice.h"
#include "assess/verdict.h"

namespace plenocal {
namespace {

bool IsTargetCause(const Finding& finding) {
  return finding.grade != Grade::kGood && finding.code.starts_with("target_");
}

// Causes in the target that residuals show: those of a wrong lens may look like them. All others
// are tested without a camera.
constexpr std::array<std::string_view, 3> kByResiduals{
    "target_ids_twice", "target_marker_moved", "target_tag_size"};

bool IsCertain(const Finding& finding) {
  return IsTargetCause(finding) &&
         std::ranges::find(kByResiduals, finding.code) == kByResiduals.end();
}

// By camera.
using LensCauses = std::map<size_t, LensCause>;

LensCauses FindAllLensCauses(const CalibrationInput& input,
                             const CalibrationRecord& record,
                             std::span<const CameraModel> models) {
  LensCauses causes;
  for (size_t c = 0; c < input.cameras.size(); ++c) {
    if (!HasUnexplainedResiduals(record.cameras[c])) continue;
    if (std::optional<LensCause> cause = FindLensCause(input, c, models)) causes[c] = *cause;
  }
  return causes;
}

// A wrong lens model bends the target that is estimated beside it, and a bent target asks for
// another lens model. What leaves the smaller residuals is the cause; markers have so many unknowns
// that equal residuals speak for the lens.
bool IsLensInstead(const BentTarget& bent, const LensCauses& lenses) {
  constexpr double kEqual = 1.2;
  return std::ranges::any_of(lenses, [&](const auto& lens) {
    return lens.second.residual < kEqual * bent.residual[lens.first];
  });
}

// Motion by rows is tested on what is not the same in all frames, and it explains more than half of
// all residuals. Images upside down do not agree with any target.
bool IsRecordingInstead(const std::vector<Finding>& findings) {
  return std::ranges::any_of(findings, [](const Finding& finding) {
    return finding.code == "rolling_shutter" || finding.code == "images_rotated";
  });
}

// Whether the points of a camera fit another lens model up to noise. No mistake of target or rig
// looks like that.
bool ExplainsAll(const LensCause& cause, const CameraFit& fit) {
  constexpr double kNoise = 2, kUnstated = 0.1;
  return cause.residual <
         (fit.detector_sigma > 0 ? kNoise * fit.detector_sigma : kUnstated * fit.noise_sigma);
}

// Large residuals of a wrong lens model make markers, tags and poses disagree.
void DropConsequences(const LensCauses& causes, CalibrationRecord* record) {
  const bool all = std::ranges::any_of(causes, [&](const auto& cause) {
    return ExplainsAll(cause.second, record->cameras[cause.first].fit);
  });
  if (!all) return;
  std::erase_if(record->findings, [](const Finding& finding) {
    return IsTargetCause(finding) || finding.code == "not_synchronous" ||
           finding.code == "rig_not_rigid";
  });
}

void AddLensCauses(const LensCauses& causes, std::vector<Finding>* findings) {
  for (const auto& [camera, cause] : causes) {
    // It names the model as well, which the estimation's own finding does not.
    std::erase_if(*findings, [&named = cause.finding.cameras](const Finding& finding) {
      return finding.code == "model_misfit" && finding.cameras == named;
    });
    findings->push_back(cause.finding);
  }
}

}  // namespace

void Diagnose(const CalibrationInput& input,
              const Calibration& calibration,
              std::span<const CameraTraits> traits,
              std::span<const CameraModel> models,
              const std::function<bool()>& go_on,
              CalibrationRecord* record) {
  std::vector<Finding>& findings = record->findings;
  Append(FindRigCauses(calibration), &findings);
  Append(FindRepeatedImages(calibration), &findings);
  for (size_t c = 0; c < traits.size(); ++c) {
    Append(FindOrientationTags(input.cameras[c].name, traits[c]), &findings);
  }
  LensCauses lenses;
  if (std::ranges::none_of(findings, IsCertain)) {
    lenses = FindAllLensCauses(input, *record, models);
    DropConsequences(lenses, record);
  }
  // A wrong target has residuals of any shape, which look like those of other causes.
  if (std::ranges::none_of(findings, IsTargetCause)) {
    Append(FindOutlierCauses(calibration), &findings);
    Append(FindRecordingCauses(calibration), &findings);
    for (size_t c = 0; c < input.cameras.size(); ++c) {
      Append(FindWorseImages(calibration, c, c < traits.size() ? traits[c] : CameraTraits()),
             &findings);
    }
    std::optional<BentTarget> bent = FindBentTarget(ChooseFrames(calibration), input.loss, go_on);
    if (bent && !IsLensInstead(*bent, lenses) && !IsRecordingInstead(findings)) {
      findings.push_back(std::move(bent->finding));
      lenses.clear();
    }
    AddLensCauses(std::move(lenses), &findings);
  }
  record->verdict = Judge(*record);
}

}  // namespace plenocal
