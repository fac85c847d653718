// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/scene/simulate_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <limits>

#include "apps/simulate/render/image_set.h"
#include "apps/simulate/scene/scene_files.h"
#include "apps/simulate/scene/scene_points.h"
#include "apps/simulate/scene/scene_surface.h"
#include "calib/base/number_text.h"
#include "calib/files/calibration_file.h"
#include "calib/files/detections.h"
#include "calib/io/output_folder.h"
#include "detectors/images/image.h"

namespace plenocal::simulate {
namespace {

// The world and the rig's path in it.
struct Staging {
  const SimulationSpec& spec;
  const Observer& observer;
  RigPath path;
  SimulatedScene scene;
};

// Calibration, recording and truth, but for what depends on tracks or images.
void WriteCommon(const Staging& staging,
                 const SimulateRequest& request,
                 const std::string& program,
                 OutputFolder* out) {
  const auto& [spec, observer, path, scene] = staging;
  CalibrationRecord truth = TrueRecord(spec), given = GivenRecord(spec);
  for (size_t c = 0; c < spec.cameras.size(); ++c) {
    if (!request.points) {
      truth.cameras[c].vignetting = fmt::format("vignetting_{}.tiff", spec.cameras[c].name);
    }
    const MicroLensOptics* optics = observer.Optics(c);
    if (optics == nullptr) continue;
    const std::string file = fmt::format("micro_lenses_{}.csv", spec.cameras[c].name);
    truth.cameras[c].micro_lenses = given.cameras[c].micro_lenses = file;
    const std::string lenses = FormatMicroLenses(optics->Array());
    out->Write(file, lenses);
    out->Write("truth/" + file, lenses);
  }
  truth.provenance = SimulationProvenance(request, program);
  given.provenance = SimulationProvenance(
      request, program, "the parameters are true but for errors of the stated sigmas");
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

std::string Summarise(const std::string& camera, const CameraTracks& tracks) {
  size_t observations = 0;
  for (const int count : tracks.observed) observations += static_cast<size_t>(count);
  const auto points = std::ranges::count_if(tracks.observed, [](int count) { return count > 0; });
  const double mean =
      points == 0 ? 0.0 : static_cast<double>(observations) / static_cast<double>(points);
  return fmt::format("{}: {} in {}, each in {:.0f} of them\n",
                     camera,
                     Counted(static_cast<size_t>(points), "point"),
                     Counted(tracks.views.size(), "frame"),
                     mean);
}

// Writes tracks and true points; returns a summary and the session.
std::string WriteTracks(const Staging& staging,
                        int threads,
                        const Progress& progress,
                        OutputFolder* out) {
  const auto& [spec, observer, path, scene] = staging;
  const std::vector<ScenePoint> points = DrawPoints(spec, observer, path, scene);
  std::string summary;
  std::vector<int> observed(points.size());
  for (size_t c = 0; c < spec.cameras.size(); ++c) {
    progress("tracks", c, spec.cameras.size());
    const CameraSpec& camera = spec.cameras[c];
    const CameraTracks tracks = TrackPoints(spec, observer, path, scene, points, c, threads);
    out->Write(fmt::format("tracks_{}.csv", camera.name),
               DetectionsCsv(tracks.views, *camera.model));
    out->Write(fmt::format("truth/wrong_matches_{}.csv", camera.name), WrongMatchesCsv(tracks));
    for (size_t i = 0; i < points.size(); ++i) observed[i] += tracks.observed[i];
    summary += Summarise(camera.name, tracks);
  }
  out->Write("truth/points.csv", PointsCsv(points));
  out->Write("truth/moving.csv", MovingCsv(points));
  out->Write("session.yaml", SceneSessionYaml(spec, true, DrawDistances(spec, points, observed)));
  return summary;
}

// Writes images and white images of all cameras; returns a summary.
std::string WriteSceneImages(const Staging& staging,
                             const SimulateRequest& request,
                             int threads,
                             const Progress& progress,
                             OutputFolder* out) {
  const auto& [spec, observer, path, scene] = staging;
  progress("optics", 0, 1);
  const SceneTexture texture = MakeSceneTexture(spec, observer);
  const std::vector<const RigInstant*> used = path.Used();
  std::vector<std::string> frames;
  for (const RigInstant* instant : used) frames.push_back(instant->name);
  const Renderers renderers = MakeRenderers(spec, observer, threads);
  std::vector<ImageTask> images;
  std::string summary;
  for (size_t c = 0; c < renderers.size(); ++c) {
    const CameraSpec& camera = spec.cameras[c];
    const auto light = [&, c](size_t frame) {
      const RigInstant& instant = *used[frame];
      const RigidTransform T_camera_world = camera.T_camera_rig * instant.T_world_rig.Inverse();
      const SceneShape everything = staging.scene.At(
          instant.time, T_camera_world.Inverse().t, std::numeric_limits<double>::infinity());
      return renderers[c]->Render(PosedScene(everything, T_camera_world, texture),
                                  SamplingSeed(staging.spec, c, frame));
    };
    std::ranges::move(
        ListCameraImages(
            spec, c, *renderers[c], frames, light, camera.IsPlenoptic() ? spec.white_images : 0),
        std::back_inserter(images));
    out->Write(fmt::format("truth/vignetting_{}.tiff", camera.name),
               EncodeImage(".tiff", renderers[c]->White()));
    summary += fmt::format("{}: {}\n", camera.name, Counted(used.size(), "image"));
  }
  WriteImages(std::move(images), request.out, threads, progress, out);
  out->Write("session.yaml", SceneSessionYaml(spec, false, {}));
  return summary;
}

}  // namespace

std::string SimulateScene(const SimulationSpec& spec,
                          const SimulateRequest& request,
                          const SimulateOptions& options,
                          const Progress& progress) {
  OutputFolder out(request.out);
  out.RefuseInputs({"session.yaml", "recording.yaml", "calibration.yaml"});
  progress("scene", 0, 1);
  const SceneSpec& limits = spec.scenery->scene;
  const Observer observer(spec);
  const RigPath path =
      MakeRigPath(spec.scenery->trajectory, limits.nearest, limits.farthest, spec.seed);
  const Staging staging{spec, observer, path, SimulatedScene(spec, observer, path)};
  std::string summary = request.points
                            ? WriteTracks(staging, options.threads, progress, &out)
                            : WriteSceneImages(staging, request, options.threads, progress, &out);
  WriteCommon(staging, request, options.program, &out);
  out.Commit();
  return summary;
}

}  // namespace plenocal::simulate
