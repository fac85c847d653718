// SPDX-License-Identifier: Apache-2.0
#include "assess/causes/diagnose.h"

#include <algorithm>
#include <map>
#include <optional>
#include <utility>

#include "assess/causes/cause.h"
#include "assess/causes/lens_cause.h"
#include "assess/target/flatness.h"
#include "assess/target/frame_choice.h"
#include "assess/verdict.h"
#include "calib/noise/camera_noise.h"

namespace plenocal {
namespace {

bool IsDefect(const Finding& finding, FindingRole role) {
  return finding.grade != Grade::kGood && finding.role == role;
}

bool IsTargetCause(const Finding& finding) {
  return IsDefect(finding, FindingRole::kTargetCause) ||
         IsDefect(finding, FindingRole::kTargetResiduals);
}

// Of the stages that test one camera after the other.
std::vector<CauseEvidence> EvidenceOfCameras(const Calibration& calibration,
                                             std::span<const CameraTraits> traits) {
  static const CameraTraits kUnknown;
  std::vector<CauseEvidence> evidence;
  for (size_t c = 0; c < calibration.bundle.cameras.size(); ++c) {
    evidence.push_back({.calibration = &calibration,
                        .camera = c,
                        .name = calibration.bundle.cameras[c].name,
                        .traits = c < traits.size() ? &traits[c] : &kUnknown});
  }
  return evidence;
}

void AddCauses(CauseStage stage,
               std::span<const CauseEvidence> cameras,
               std::vector<Finding>* findings) {
  for (const CauseEvidence& camera : cameras) Append(FindCauses(stage, camera), findings);
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
    return IsTargetCause(finding) || finding.role == FindingRole::kRigCause;
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

std::vector<Finding> FindTargetCauses(const CalibrationInput& input,
                                      const TargetDoubts& doubts,
                                      const Calibration* calibration) {
  const std::vector<CameraInput> cameras = ChooseFrames(input.cameras);
  const CauseEvidence evidence{
      .inputs = &cameras, .markers = &input.markers, .doubts = &doubts, .calibration = calibration};
  std::vector<Finding> findings = FindCauses(CauseStage::kLayout, evidence);
  // The rest measures with a calibration, which a wrong layout has spoilt.
  if (!findings.empty() || calibration == nullptr) return findings;
  findings = FindCauses(CauseStage::kTarget, evidence);
  std::ranges::stable_sort(findings, std::ranges::greater(), &Finding::grade);
  return findings;
}

void Diagnose(const CalibrationInput& input,
              const Calibration& calibration,
              std::span<const CameraTraits> traits,
              std::span<const CameraModel> models,
              const std::function<bool()>& go_on,
              CalibrationRecord* record) {
  std::vector<Finding>& findings = record->findings;
  std::vector<CauseEvidence> cameras = EvidenceOfCameras(calibration, traits);
  Append(FindCauses(CauseStage::kRig, {.calibration = &calibration}), &findings);
  AddCauses(CauseStage::kImages, cameras, &findings);
  AddCauses(CauseStage::kImageFile, cameras, &findings);
  LensCauses lenses;
  if (std::ranges::none_of(
          findings, [](const Finding& f) { return IsDefect(f, FindingRole::kTargetCause); })) {
    lenses = FindAllLensCauses(input, *record, models);
    DropConsequences(lenses, record);
  }
  // A wrong target has residuals of any shape, which look like those of other causes.
  if (std::ranges::none_of(findings, IsTargetCause)) {
    AddCauses(CauseStage::kPoints, cameras, &findings);
    for (CauseEvidence& camera : cameras) {
      if (calibration.fits[camera.camera].noise_sigma >= kRoundingNoise) {
        camera.views = RowsOfViews(calibration.bundle, camera.camera);
      }
      Append(FindCauses(CauseStage::kMotion, camera), &findings);
      camera.views.clear();
    }
    AddCauses(CauseStage::kNoise, cameras, &findings);
    std::optional<BentTarget> bent =
        FindBentTarget(ChooseMarkers(ChooseFrames(calibration)), input.loss, go_on);
    // Motion by rows is tested on what is not the same in all frames, and it explains more than
    // half of all residuals. Images upside down do not agree with any target.
    const bool is_image = std::ranges::any_of(
        findings, [](const Finding& f) { return f.role == FindingRole::kImageDistortion; });
    if (bent && !is_image && !IsLensInstead(*bent, lenses)) {
      findings.push_back(std::move(bent->finding));
      lenses.clear();
    }
    AddLensCauses(std::move(lenses), &findings);
  }
  record->verdict = Judge(*record);
}

}  // namespace plenocal
