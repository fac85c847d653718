// SPDX-License-Identifier: Apache-2.0
#include "engine/check_session.h"

#include <algorithm>

#include "assess/model_trial.h"
#include "assess/text/compare_text.h"
#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/estimate/describe.h"
#include "calib/io/input_file.h"
#include "engine/observe/session_observations.h"
#include "engine/session/calibration_folder.h"
#include "engine/session/calibration_input.h"
#include "engine/session/open_session.h"
#include "engine/session/session_targets.h"

namespace plenocal {
namespace {

// What the session leaves open is as in the calibration that is checked.
void UseChoiceOf(const CalibrationRecord& old, Session* session) {
  for (SessionCamera& camera : session->cameras) {
    const auto same = std::ranges::find(old.cameras, camera.name, &CalibratedCamera::name);
    if (!camera.auto_model || same == old.cameras.end()) continue;
    if (OfOneKind(*same->model, *camera.model)) UseModel(*same->model, &camera);
  }
  if (!session->auto_refine) return;
  session->refine_target = !old.adjustment.value_or(AdjustmentRecord{}).marker_freedom.IsHeld();
}

}  // namespace

SessionCheck CheckSession(Session session, const CheckRequest& request, const Run& run) {
  const RunScope inputs;
  return CheckSession(std::move(session), OpenWithCorrelations(request.calibration), request, run);
}

SessionCheck CheckSession(Session session,
                          CalibrationRecord old,
                          const CheckRequest& request,
                          const Run& run) {
  const RunScope inputs;
  UseOptions(request, &session);
  if (!request.map.empty()) RenameCameras(request.map, NamesOf(session.cameras), &old);
  UseChoiceOf(old, &session);
  RefuseSeveralTargets(session, "compare --check");
  if (session.scene) {
    throw InputError(
        "{0}: has a scene in place of a target, and no poses without a "
        "calibration of its own; calibrate it, then compare both: plenocal "
        "calibrate {0} -o NEW; plenocal compare {1} NEW/calibration.yaml",
        session.path.string(),
        old.path.string());
  }
  const Target target = ReadTarget(session.target);
  SessionOptions places = request;
  if (places.cache.empty()) places.cache = request.out;  // which keeps those of other sessions
  SessionCheck result;
  result.folders = std::make_unique<RunFolders>(
      places, session, std::vector<std::string>{
          "compare.csv", "compare_space.csv", "check.json", "difference.png"});
  const SessionObservations observations =
      CollectObservations(session, target, run, {result.folders->cache(), nullptr});
  result.check =
      CheckCalibration(old,
                       MakeCalibrationInput(session, target, observations.cameras, run),
                       {.threads = run.threads,
                        .progress = [&](const std::string& stage) { return run.Progress(stage); }});
  const CalibrationRecord fresh = Describe(result.check.fresh);
  if (request.in_space) result.space = CompareInSpace(old, fresh, request);
  if (OutputFolder* const out = result.folders->out()) {
    result.comparison = CompareCalibrations(fresh, old, request.distances);
    out->Write("compare.csv", ComparisonCsv(*result.comparison));
    if (result.space) out->Write("compare_space.csv", SpaceCsv(*result.space));
  }
  return result;
}

}  // namespace plenocal
