// SPDX-License-Identifier: Apache-2.0
#include "engine/suggest_views.h"

#include <fmt/format.h>

#include <map>
#include <numbers>

#include "assess/space/depth_sigma.h"
#include "assess/verdict.h"
#include "assess/views/view_information.h"
#include "calib/base/format_error.h"
#include "calib/base/number_limits.h"
#include "calib/estimate/describe.h"
#include "calib/io/input_file.h"
#include "engine/observe/auto_model.h"
#include "engine/observe/session_observations.h"
#include "engine/session/earlier_session.h"
#include "engine/session/open_session.h"
#include "engine/session/session_targets.h"
#include "engine/suggest/first_rig_estimate.h"
#include "engine/suggest/read_rig_estimate.h"
#include "engine/suggest/view_target.h"

namespace plenocal {
namespace {

double Radians(double degrees) { return degrees * std::numbers::pi / 180; }

// Cameras of a given angle with the information of a calibration's images: parameters that these do
// not determine may be anywhere in the calibration.
SuggestedViews BasisOfImages(const CalibrationRecord& calibration,
                             const Target& target,
                             double angle_deg) {
  std::vector<FirstCamera> cameras;
  for (const CalibratedCamera& camera : calibration.cameras) {
    cameras.push_back({.name = camera.name,
                       .model = camera.model,
                       .image_size = camera.image_size,
                       .angle = Radians(angle_deg),
                       .views = ViewsOf(calibration, camera)});
  }
  const MarkerFreedom marker_freedom =
      calibration.adjustment.value_or(AdjustmentRecord{}).marker_freedom;
  return {MakeFirstRigEstimate(cameras, target.markers, marker_freedom),
          MakeViewTarget(target),
          calibration.verdict};
}

// Micro lenses are in the folder that the calibration of a plenoptic camera was written to.
void RefusePlenoptic(const std::vector<CalibratedCamera>& cameras, const std::string& input) {
  for (const CalibratedCamera& camera : cameras) {
    if (!camera.model->plenoptic) continue;
    throw InputError(
        "{}: suggestions for a plenoptic camera need its micro lenses; run "
        "'plenocal calibrate {} -o OUT', then 'plenocal suggest OUT'",
        camera.name,
        input);
  }
}

SuggestedViews BasisOfRecord(const CalibrationRecord& calibration,
                             const Target& target,
                             const std::string& input) {
  RefusePlenoptic(calibration.cameras, input);
  SuggestedViews basis{MakeRigEstimate(calibration), MakeViewTarget(target), calibration.verdict};
  SetFactors(calibration, basis.shape, &basis.rig);
  return basis;
}

SuggestedViews BasisOfCalibration(const std::filesystem::path& folder, double angle_deg) {
  const CalibrationRecord calibration = ReadTargetCalibration(folder);
  const Target target = ReadTarget(folder / "target.yaml");
  if (angle_deg > 0) return BasisOfImages(calibration, target, angle_deg);
  ViewTarget shape = MakeViewTarget(target);
  RigEstimate rig = MakeRigEstimate(folder, calibration, shape);
  return {std::move(rig), std::move(shape), calibration.verdict};
}

std::vector<FirstCamera> FirstCameras(const Session& session,
                                      const std::vector<CameraInput>& cameras,
                                      const SuggestRequest& request) {
  std::vector<FirstCamera> first;
  for (size_t c = 0; c < session.cameras.size(); ++c) {
    const SessionCamera& camera = session.cameras[c];
    ImageSize of_camera = request.size.value_or(camera.image_size);
    if (c < cameras.size()) of_camera = cameras[c].image_size;
    if (of_camera == ImageSize{}) {
      throw InputError("{}: give --size WxH, the size of its images", camera.name);
    }
    first.push_back({.name = camera.name,
                     .model = camera.model,
                     .image_size = of_camera,
                     .angle = Radians(request.angle),
                     .views = c < cameras.size() ? cameras[c].views : std::vector<View>()});
  }
  return first;
}

// The calibration of a session; where its images do not suffice for one, cameras of the given angle
// with their information.
SuggestedViews BasisOfSession(Session session, const SuggestRequest& request, const Run& run) {
  UseOptions(request, &session);
  RefuseSeveralTargets(session, "suggest");
  if (session.scene) {
    throw InputError("{}: has a scene in place of a target; next views are for a target",
                     session.path.string());
  }
  const Target target = ReadTarget(session.target);
  SessionObservations observations = CollectObservations(session, target, run, {});
  (void)ChooseByHeldOutFrames(target, run, &session, &observations);
  const CalibrationInput input =
      MakeInputOnEarlier(session, target, observations.cameras, run).input;
  try {
    const Calibration calibration =
        Calibrate(input, {.threads = run.threads, .progress = [&](const std::string& stage) {
                            return run.Progress(stage);
                          }});
    CalibrationRecord record = Describe(calibration);
    record.verdict = Judge(record);
    return BasisOfRecord(record, target, session.path.string());
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::kJob) throw;
    if (request.angle == 0) {
      throw JobError(
          "{}; for suggestions from so few images give --angle DEGREES, the "
          "lens' horizontal field of view",
          error.what());
    }
    run.Message(
        fmt::format("{}; a lens of {:.0f} degrees is assumed", error.what(), request.angle));
  }
  return {MakeFirstRigEstimate(FirstCameras(session, observations.cameras, request),
                               target.markers,
                               input.marker_freedom),
          MakeViewTarget(target),
          std::nullopt};
}

// Before the first image.
SuggestedViews BasisOfLens(const SuggestRequest& request) {
  if (request.target.empty() || !request.size || request.angle == 0) {
    throw InputError(
        "suggest: give session.yaml or the folder of a calibration; before the first image "
        "--target, --size and --angle");
  }
  const Target target = ReadTarget(TargetNamed(request.target));
  return {MakeFirstRigEstimate({{.name = "camera",
                                 .model = ModelNamed("--model", request.model),
                                 .image_size = *request.size,
                                 .angle = Radians(request.angle)}},
                               target.markers,
                               MarkerFreedom::Rigid()),
          MakeViewTarget(target),
          std::nullopt};
}

// The folder of a calibration; empty: the input is none.
std::filesystem::path FolderOf(const std::filesystem::path& input) {
  if (std::filesystem::is_directory(input)) return input;
  if (input.filename() != "calibration.yaml") return {};
  return input.parent_path().empty() ? std::filesystem::path(".") : input.parent_path();
}

SuggestedViews BasisOf(const SuggestRequest& request, const Run& run) {
  if (request.input.empty()) return BasisOfLens(request);
  const std::filesystem::path folder = FolderOf(request.input);
  return folder.empty() ? BasisOfSession(OpenSession(request.input), request, run)
                        : BasisOfCalibration(folder, request.angle);
}

void CheckNumbers(const SuggestRequest& request) {
  constexpr double kFar = 1e6;  // m
  RequireWithin("angle", request.angle, 0, 300);
  RequireWithin("count", request.count, 1, 100);
  RequireWithin("near", request.nearest, 0, kFar);
  RequireWithin("far", request.farthest, 0, kFar);
  RequireWithin("tilt", request.tilt, 0, 75);
  RequireWithin("goal", request.goal, 0, kFar);
  RequireWithin("goal: depth", request.depth_at, 0, kFar);
}

SuggestedViews ChooseViews(SuggestedViews suggested,
                           const SuggestRequest& request,
                           const Run& run) {
  run.Progress("views");
  NextViewOptions options{.count = request.count,
                          .range = {request.nearest, request.farthest},
                          .largest_tilt = Radians(request.tilt),
                          .goal = request.goal,
                          .threads = run.threads};
  if (request.depth_at > 0) {
    options.lowered = [&](const RigEstimate& rig, const RigUnknowns& unknowns) {
      return DepthSigma(rig, unknowns, request.depth_at);
    };
  }
  suggested.views = ChooseNextViews(suggested.rig, suggested.shape, options);
  return suggested;
}

}  // namespace

SuggestedViews SuggestViews(const SuggestRequest& request, const Run& run) {
  const RunScope inputs;
  CheckNumbers(request);
  return ChooseViews(BasisOf(request, run), request, run);
}

SuggestedViews SuggestViews(const Session& session, const SuggestRequest& request, const Run& run) {
  const RunScope inputs;
  CheckNumbers(request);
  return ChooseViews(BasisOfSession(session, request, run), request, run);
}

SuggestedViews SuggestViews(const CalibrationRecord& calibration,
                            const Target& target,
                            const SuggestRequest& request,
                            const Run& run) {
  const RunScope inputs;
  CheckNumbers(request);
  Target placed = target;
  for (const auto& [number, marker] : calibration.markers) placed.markers[number] = marker.position;
  return ChooseViews(request.angle > 0 ? BasisOfImages(calibration, placed, request.angle)
                                       : BasisOfRecord(calibration, placed, "session.yaml"),
                     request,
                     run);
}

PictureGain EvaluatePictures(const std::filesystem::path& calibration,
                             const std::map<std::string, FrameImage>& pictures,
                             const Run& run) {
  const RunScope inputs;
  const std::filesystem::path folder = FolderOf(calibration);
  if (folder.empty()) {
    throw InputError(
        "--image: pictures are weighed against a calibration: give the folder that "
        "'plenocal calibrate' wrote");
  }
  return PictureGainEvaluator(folder, run.threads).Evaluate(pictures);
}

}  // namespace plenocal
