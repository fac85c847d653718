// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/scene/simulate_scene.h"

#include <fmt/format.h>

#include <algorithm>

#include "apps/simulate/provenance.h"
#include "apps/simulate/scene/scene_files.h"
#include "apps/simulate/scene/scene_points.h"
#include "calib/base/error.h"
#include "calib/base/output_folder.h"
#include "calib/files/calibration_file.h"
#include "calib/files/detections.h"
#include "calib/base/number_text.h"

namespace plenocal::simulate {
namespace {

// Calibration, recording and truth, but for what depends on tracks or images.
void WriteCommon(const SimulationSpec& spec,
                 const SimulateRequest& request,
                 const SimulateOptions& options,
                 const Observer& observer,
                 const RigPath& path,
                 OutputFolder* out) {
  CalibrationRecord truth = TrueRecord(spec), given = GivenRecord(spec);
  for (size_t c = 0; c < spec.cameras.size(); ++c) {
    const MicroLensOptics* optics = observer.Optics(c);
    if (optics == nullptr) continue;
    const std::string file = fmt::format("micro_lenses_{}.csv", spec.cameras[c].name);
    truth.cameras[c].micro_lenses = given.cameras[c].micro_lenses = file;
    const std::string lenses = FormatMicroLenses(optics->Array());
    out->Write(file, lenses);
    out->Write("truth/" + file, lenses);
  }
  truth.provenance = SimulationProvenance(request, options.program, kTrueParameters);
  given.provenance = SimulationProvenance(
      request, options.program, "the parameters are true but for errors of the stated sigmas");
  out->Write("truth/calibration.yaml", CalibrationYaml(truth));
  out->Write("calibration.yaml", CalibrationYaml(given));
  out->Write("recording.yaml", RecordingYaml(spec, request.points));
  out->Write("times.txt", TimesText(path));
  out->Write("truth/poses.csv", PathPosesCsv(path));
  for (const CameraSpec& camera : spec.cameras) {
    out->Write(fmt::format("truth/segments_{}.txt", camera.name),
               TrajectoryText(path, camera, PathExtent::kSegments));
    out->Write(fmt::format("truth/trajectory_{}.txt", camera.name),
               TrajectoryText(path, camera, PathExtent::kWhole));
  }
}

std::string SummaryOf(const std::string& camera, const CameraTracks& tracks) {
  size_t observations = 0;
  for (const int count : tracks.observed) observations += static_cast<size_t>(count);
  const auto points = std::ranges::count_if(tracks.observed, [](int count) { return count > 0; });
  return fmt::format("{}: {} in {}, each in {:.0f} of them\n",
                     camera,
                     Counted(static_cast<size_t>(points), "point"),
                     Counted(tracks.views.size(), "frame"),
                     points == 0 ? 0.0 : static_cast<double>(observations) / static_cast<double>(points));
}

}  // namespace

std::string SimulateScene(
    const SimulationSpec& spec,
    const SimulateRequest& request,
    const SimulateOptions& options,
    const std::function<void(const std::string& stage, size_t done, size_t total)>& progress) {
  if (!request.points) {
    throw Error(ErrorKind::kInput,
                spec.path.string() + ": images of a scene cannot be made yet; add --points");
  }
  OutputFolder out(request.out);
  out.RefuseInputs({"session.yaml", "recording.yaml", "calibration.yaml"});
  const SceneSpec& limits = spec.scenery->scene;
  progress("scene", 0, 1);
  const Observer observer(spec);
  const RigPath path =
      MakeRigPath(spec.scenery->trajectory, limits.nearest, limits.farthest, spec.seed);
  const SimulatedScene scene(spec, observer, path);
  const std::vector<ScenePoint> points = DrawPoints(spec, observer, path, scene);
  std::string summary;
  std::vector<int> observed(points.size());
  for (size_t c = 0; c < spec.cameras.size(); ++c) {
    progress("tracks", c, spec.cameras.size());
    const CameraSpec& camera = spec.cameras[c];
    const CameraTracks tracks =
        TrackPoints(spec, observer, path, scene, points, c, options.threads);
    out.Write(fmt::format("tracks_{}.csv", camera.name),
              DetectionsCsv(tracks.views, *camera.model));
    out.Write(fmt::format("truth/wrong_matches_{}.csv", camera.name), WrongMatchesCsv(tracks));
    for (size_t i = 0; i < points.size(); ++i) observed[i] += tracks.observed[i];
    summary += SummaryOf(camera.name, tracks);
  }
  WriteCommon(spec, request, options, observer, path, &out);
  out.Write("truth/points.csv", PointsCsv(points));
  out.Write("truth/moving.csv", MovingCsv(points));
  out.Write("session.yaml",
            SceneSessionYaml(spec, request.points, DrawDistances(spec, points, observed)));
  out.Commit();
  return summary;
}

}  // namespace plenocal::simulate
