// SPDX-License-Identifier: Apache-2.0
#include "engine/observe/auto_model.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include "assess/projection_map.h"
#include "assess/text/trial_text.h"
#include "calib/base/number_text.h"
#include "engine/session/calibration_input.h"
#include "engine/session/open_session.h"
#include "models/registry.h"

namespace plenocal {
namespace {

// Least difference between models that the reasons state, px.
constexpr double kStatedDisagreement = 0.01;

size_t CountFrames(const SessionObservations& observations) {
  std::set<std::string> frames;
  for (const CameraInput& camera : observations.cameras) {
    for (const View& view : camera.views) frames.insert(view.frame);
  }
  return frames.size();
}

// What is left open cannot be chosen.
std::string TakeUsual(size_t frames, bool is_model_open, Session* session) {
  std::vector<std::string> used;
  if (is_model_open) used.push_back(fmt::format("camera model {}", kUsualModel));
  if (session->auto_refine) {
    used.emplace_back("a rigid target");
    session->refine_target = false;
  }
  return fmt::format("{} are too few to choose by: {} taken; record {} or more.",
                     Counted(frames, "frame"),
                     fmt::join(used, " and "),
                     kFewestTrialFrames);
}

std::vector<const CameraModel*> CommonModels() {
  std::vector<const CameraModel*> models;
  for (const CameraModel& model : CameraModels()) {
    if (OfOneKind(model, UsualModel()) && model.usage == Usage::kCommon) models.push_back(&model);
  }
  return models;
}

// Adds why, in the words of `try`.
void ChooseParts(const Target& target,
                 const Run& run,
                 const std::vector<size_t>& open,
                 Session* session,
                 const std::vector<CameraInput>& cameras,
                 Finding* note) {
  std::vector<size_t> varied = open;
  for (size_t c = 0; open.empty() && c < cameras.size(); ++c) {
    if (cameras[c].model == cameras[0].model) varied.push_back(c);
  }
  const ModelAndTarget tried =
      TryModelsAndTarget(MakeCalibrationInput(*session, target, cameras, {}),
                         varied,
                         open.empty() ? std::vector<const CameraModel*>() : CommonModels(),
                         RefinedMarkerFreedom(target),
                         session->auto_refine ? TargetQuestion::kChoose : TargetQuestion::kNone,
                         {.threads = run.threads,
                          .progress = [&](const std::string& stage, size_t done, size_t total) {
                            return run.Progress(stage, done, total);
                          }});
  std::vector<std::string> reasons;
  if (!open.empty()) {
    const ModelTrial& chosen = tried.models.trials[tried.models.recommended];
    for (const size_t c : open) UseModel(*chosen.model, &session->cameras[c]);
    reasons.push_back(fmt::format("Camera model: {}.", ModelRecommendation(tried.models)));
    note->value = tried.models.disagreement;
    if (tried.models.disagreement >= kStatedDisagreement) {
      reasons.push_back(fmt::format(
          "Models that predict as well differ from it by {:.2g} px within {:.0f} % of the image.",
          tried.models.disagreement,
          100 * kMostOfImage));
    }
  }
  if (session->auto_refine) {
    const MarkerFreedom freedom = tried.targets.trials[tried.targets.recommended].marker_freedom;
    session->refine_target = !freedom.IsRigid();
    reasons.push_back(fmt::format("Target: {}.", TargetRecommendation(tried.targets, freedom)));
  }
  note->what = fmt::format("{}", fmt::join(reasons, " "));
}

}  // namespace

std::optional<Finding> ChooseByHeldOutFrames(const Target& target,
                                             const Run& run,
                                             Session* session,
                                             SessionObservations* observations) {
  // Who made it states how far its points may be off.
  if (target.tolerance) session->auto_refine = false;
  std::vector<size_t> open;
  for (size_t c = 0; c < session->cameras.size(); ++c) {
    if (session->cameras[c].auto_model) open.push_back(c);
  }
  if (open.empty() && !session->auto_refine) return std::nullopt;
  Finding note{.code = "automatic_choice", .grade = Grade::kGood};
  const size_t frames = CountFrames(*observations);
  if (frames < kFewestTrialFrames) {
    note.what = TakeUsual(frames, !open.empty(), session);
  } else {
    ChooseParts(target, run, open, session, observations->cameras, &note);
  }
  std::vector<std::string> keys;
  for (const size_t c : open) {
    SessionCamera& camera = session->cameras[c];
    camera.auto_model = false;
    UseSessionCamera(camera, &observations->cameras[c]);
    note.cameras.push_back(camera.name);
    keys.push_back(fmt::format("{}: {{model: {}}}", camera.name, camera.model->name));
  }
  if (session->auto_refine) {
    keys.push_back(fmt::format("refine_target: {}", *session->refine_target));
    session->auto_refine = false;
  }
  note.remedy =
      fmt::format("To keep this choice, state it in the session: {}.", fmt::join(keys, ", "));
  return note;
}

}  // namespace plenocal
