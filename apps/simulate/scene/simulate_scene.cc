// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/scene/simulate_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <memory>

#include "apps/simulate/image_set.h"
#include "apps/simulate/provenance.h"
#include "apps/simulate/random.h"
#include "apps/simulate/scene/scene_files.h"
#include "apps/simulate/scene/scene_points.h"
#include "apps/simulate/scene/scene_surface.h"
#include "apps/simulate/sensor.h"
#include "calib/base/error.h"
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
  truth.provenance = SimulationProvenance(request, program, kTrueParameters);
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

std::string SummaryOf(const std::string& camera, const CameraTracks& tracks) {
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

using SceneProgress =
    std::function<void(const std::string& stage, std::size_t done, std::size_t total)>;

// Writes tracks and true points; returns a summary and the session.
std::string WriteTracks(const Staging& staging,
                        int threads,
                        const SceneProgress& progress,
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
    summary += SummaryOf(camera.name, tracks);
  }
  out->Write("truth/points.csv", PointsCsv(points));
  out->Write("truth/moving.csv", MovingCsv(points));
  out->Write("session.yaml", SceneSessionYaml(spec, true, DrawDistances(spec, points, observed)));
  return summary;
}

cv::Mat TakeSceneImage(const Staging& staging,
                       const SceneTexture& texture,
                       const Renderer& renderer,
                       size_t c,
                       const RigInstant& instant,
                       size_t frame) {
  const CameraSpec& camera = staging.spec.cameras[c];
  const RigidTransform T_camera_world = camera.T_camera_rig * instant.T_world_rig.Inverse();
  const Eigen::Vector3d viewer = T_camera_world.Inverse().t;
  const double everywhere = std::numeric_limits<double>::infinity();
  const PosedScene posed(
      staging.scene.At(instant.time, viewer, everywhere), T_camera_world, texture);
  Random random(staging.spec.seed, "image", {c, frame});
  const std::uint64_t sampling =
      static_cast<std::uint64_t>(staging.spec.seed) * 1000003 + c * 65537 + frame;
  return Expose(renderer.Render(posed, sampling), camera.sensor, &random);
}

// Writes images and white images of all cameras; returns a summary.
std::string WriteSceneImages(const Staging& staging,
                             const SimulateRequest& request,
                             int threads,
                             const SceneProgress& progress,
                             OutputFolder* out) {
  const auto& [spec, observer, path, scene] = staging;
  progress("optics", 0, 1);
  const SceneTexture texture = MakeSceneTexture(spec, observer);
  const std::vector<const RigInstant*> used = path.Used();
  std::vector<std::unique_ptr<Renderer>> renderers;
  std::vector<ImageTask> images;
  std::string summary;
  for (size_t c = 0; c < spec.cameras.size(); ++c) {
    const CameraSpec& camera = spec.cameras[c];
    renderers.push_back(MakeRenderer(camera, observer.Optics(c), spec.seed, threads));
    const Renderer& renderer = *renderers.back();
    for (size_t f = 0; f < used.size(); ++f) {
      images.push_back({fmt::format("{}/{}.png", camera.name, used[f]->name), [&, c, f] {
                          return TakeSceneImage(staging, texture, renderer, c, *used[f], f);
                        }});
    }
    for (size_t i = 0; camera.IsPlenoptic() && i < static_cast<size_t>(spec.white_images); ++i) {
      images.push_back({fmt::format("{}_white/white_{:02}.png", camera.name, i), [&, c, i] {
                          return TakeWhite(renderer, camera, staging.spec.seed, c, i);
                        }});
    }
    out->Write(fmt::format("truth/vignetting_{}.tiff", camera.name),
               EncodeImage(".tiff", renderer.White()));
    summary += fmt::format("{}: {}\n", camera.name, Counted(used.size(), "image"));
  }
  RefuseOtherImages(images, request.out);
  WriteImages(
      images, threads, [&](size_t done, size_t total) { progress("images", done, total); }, out);
  out->Write("session.yaml", SceneSessionYaml(spec, false, {}));
  return summary;
}

}  // namespace

std::string SimulateScene(const SimulationSpec& spec,
                          const SimulateRequest& request,
                          const SimulateOptions& options,
                          const SceneProgress& progress) {
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
