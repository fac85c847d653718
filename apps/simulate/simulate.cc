// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/simulate.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <future>
#include <iterator>
#include <map>
#include <optional>
#include <string_view>
#include <vector>

#include "apps/simulate/photometry/exposures.h"
#include "apps/simulate/photometry/wall_surface.h"
#include "apps/simulate/render/image_set.h"
#include "apps/simulate/render/observer.h"
#include "apps/simulate/render/renderer.h"
#include "apps/simulate/scene/simulate_scene.h"
#include "apps/simulate/spec/random.h"
#include "apps/simulate/spec/simulation_spec.h"
#include "apps/simulate/targets/pose_set.h"
#include "apps/simulate/targets/several_targets.h"
#include "apps/simulate/targets/target_surface.h"
#include "calib/base/error.h"
#include "calib/base/names.h"
#include "calib/base/number_text.h"
#include "calib/base/parallel.h"
#include "calib/base/quoted_text.h"
#include "calib/files/calibration_file.h"
#include "calib/files/calibration_tables.h"
#include "calib/files/detections.h"
#include "calib/io/output_folder.h"
#include "detectors/images/image.h"

namespace plenocal {
namespace simulate {
namespace {

// The simulated world, without errors of measurement.
struct Scene {
  SimulationSpec spec;
  std::optional<SceneTexture> texture;  // of the wall
  Exposures exposures;                  // empty: equal
  Target target;                        // of several, all together
  TrueTarget made;                      // likewise
  std::vector<TargetInRoom> targets;
  std::vector<Frame> frames;
  std::vector<std::vector<View>> views;  // exact; by camera and frame
};

std::string SessionYaml(const Scene& scene, const SimulateRequest& request) {
  std::string text = "plenocal: 1\n";
  text += TargetsOfSession(scene.targets);
  text += "cameras:\n";
  for (const CameraSpec& camera : scene.spec.cameras) {
    text += ModelKeys(camera);
    text += request.points ? DetectionKeys(camera, fmt::format("detections_{}.csv", camera.name))
                           : ImageKeys(camera, true) + BayerKey(camera);
    if (scene.spec.poses.moving) text += fmt::format("    times: times_{}.txt\n", camera.name);
    text += ConfigKeys(camera);
  }
  return text;
}

// The truth as the result of a calibration without errors.
CalibrationRecord TrueCalibration(const Scene& scene) {
  CalibrationRecord truth = TrueRecord(scene.spec);
  const std::vector<CameraSpec>& cameras = scene.spec.cameras;
  for (size_t c = 0; c < cameras.size(); ++c) {
    if (scene.spec.poses.moving && c > 0) {
      truth.cameras[c].time_shift =
          EstimatedNumber{cameras[c].time_shift - cameras[0].time_shift, 0};
    }
    CameraFit& fit = truth.cameras[c].fit;
    for (const View& view : scene.views[c]) {
      fit.points += static_cast<int>(view.observations.size());
      fit.views += view.observations.empty() ? 0 : 1;
    }
  }
  for (const Frame& frame : scene.frames) {
    truth.frames.push_back({frame.name, frame.T_rig_target.Inverse()});
  }
  return truth;
}

std::string FramesCsv(const Scene& scene) {
  std::string text = "frame,kind";
  for (const CameraSpec& camera : scene.spec.cameras) text += ",markers_" + camera.name;
  text += '\n';
  for (size_t f = 0; f < scene.frames.size(); ++f) {
    text += CsvCell(scene.frames[f].name) + "," + scene.frames[f].kind;
    for (const auto& views : scene.views) {
      text += fmt::format(",{}", CountMarkers(views[f].observations));
    }
    text += '\n';
  }
  return text;
}

void WriteTruth(const Scene& scene,
                const Observer& observer,
                const Renderers& renderers,
                const SimulateRequest& request,
                const std::string& program,
                OutputFolder* out) {
  CalibrationRecord truth = TrueCalibration(scene);
  for (size_t c = 0; c < scene.spec.cameras.size(); ++c) {
    const std::string& name = scene.spec.cameras[c].name;
    if (const MicroLensOptics* optics = observer.Optics(c)) {
      const std::string file = fmt::format("micro_lenses_{}.csv", name);
      truth.cameras[c].micro_lenses = file;
      out->Write("truth/" + file, FormatMicroLenses(optics->Array()));
    }
    if (renderers[c]) {
      const std::string file = fmt::format("vignetting_{}.tiff", name);
      truth.cameras[c].vignetting = file;
      out->Write("truth/" + file, EncodeImage(".tiff", renderers[c]->White()));
    }
    if (scene.spec.cameras[c].sensor.response) {
      out->Write(fmt::format("truth/pcalib_{}.txt", name),
                 PcalibText(scene.spec.cameras[c].sensor.response->curve));
    }
    out->Write(fmt::format("truth/detections_{}.csv", name),
               DetectionsCsv(scene.views[c], *scene.spec.cameras[c].model));
  }
  for (const TargetInRoom& target : scene.targets) {
    if (target.IsOnlyOne()) continue;
    truth.targets.push_back({.name = target.name, .T_target_own = target.T_target_own});
    out->Write("truth/" + TargetFile(target),
               RefinedTargetYaml(target.target, target.made.markers, {}));
  }
  truth.provenance = SimulationProvenance(request, program);
  out->Write("truth/calibration.yaml", CalibrationYaml(truth));
  out->Write("truth/target.yaml", RefinedTargetYaml(scene.target, scene.made.markers, {}));
  out->Write("truth/poses.csv", PosesCsv(truth));
  out->Write("truth/frames.csv", FramesCsv(scene));
}

cv::Mat RenderFrame(const Scene& scene,
                    const TargetSurface& surface,
                    const Renderer& renderer,
                    size_t c,
                    size_t frame) {
  const RigidTransform T_camera_target =
      scene.spec.cameras[c].T_camera_rig * scene.frames[frame].PoseFor(c);
  const PosedSurface posed(surface, T_camera_target);
  const std::uint64_t seed = SamplingSeed(scene.spec, c, frame);
  if (!scene.spec.wall) return renderer.Render(posed, seed);
  return renderer.Render(WallSurface(*scene.spec.wall, *scene.texture, posed, T_camera_target),
                         seed);
}

std::vector<std::string> FrameNames(const Scene& scene) {
  const std::vector<std::string_view> names = NamesOf(scene.frames);
  return {names.begin(), names.end()};
}

std::vector<View> WithNoise(std::vector<View> views, const CameraSpec& camera, size_t c, int seed) {
  for (size_t f = 0; f < views.size(); ++f) {
    Random random(seed, "detections", {c, f});
    for (Observation& observation : views[f].observations) AddNoise(camera, &random, &observation);
  }
  return views;
}

// The range of the markers' virtual depths, for choosing the virtual depths at which the lens types
// are in focus.
std::string VirtualDepthText(const std::vector<View>& views, const CameraSpec& camera) {
  std::vector<double> depths;
  for (const View& view : views) {
    std::map<int, std::vector<const Observation*>> of_marker;
    for (const Observation& seen : view.observations) of_marker[seen.marker].push_back(&seen);
    for (const auto& [marker, seen] : of_marker) {
      // x = c + (q - c) / T: x changes by 1 - 1 / T of what c does.
      const Eigen::Map<const Eigen::Vector4d> a(seen.front()->values.data());
      const Eigen::Map<const Eigen::Vector4d> b(seen.back()->values.data());
      const Eigen::Vector2d x = a.head<2>() - b.head<2>(), centre = a.tail<2>() - b.tail<2>();
      const double square = centre.squaredNorm();
      if (square > 0) depths.push_back(1 / (1 - x.dot(centre) / square));
    }
  }
  if (depths.empty()) return {};
  const auto [least, greatest] = std::minmax_element(depths.begin(), depths.end());
  return fmt::format(", at virtual depths from {:.2f} to {:.2f} (sharp: {:.4g})",
                     *least,
                     *greatest,
                     fmt::join(camera.micro_lenses->focus, ", "));
}

// Everything but the images: target, poses and exact observations.
void ObserveScene(const Observer& observer, int threads, const Progress& progress, Scene* scene) {
  const SimulationSpec& spec = scene->spec;
  progress("poses", 0, 1);
  std::vector<TrueTarget> targets;
  for (size_t k = 0; k < scene->targets.size(); ++k) {
    targets.push_back(InFrameOfFirst(scene->targets[k], k));
  }
  scene->frames = MakePoses(spec, observer, targets);
  scene->views.resize(spec.cameras.size());
  for (size_t c = 0; c < spec.cameras.size(); ++c) {
    scene->views[c].resize(scene->frames.size());
    ParallelFor(scene->frames.size(), threads, [&](size_t f) {
      const Frame& frame = scene->frames[f];
      scene->views[c][f] = {frame.name, observer.Observe(c, scene->made, frame.PoseFor(c))};
    });
    progress("markers", c + 1, spec.cameras.size());
  }
}

// All images; of a rig that stands still the light of a camera is made once.
std::vector<ImageTask> ListImages(const Scene& scene,
                                  const TargetSurface& surface,
                                  const Renderers& renderers) {
  const SimulationSpec& spec = scene.spec;
  std::vector<ImageTask> tasks;
  for (size_t c = 0; c < renderers.size(); ++c) {
    const auto render = [&, c](size_t frame) {
      return RenderFrame(scene, surface, *renderers[c], c, frame);
    };
    const std::shared_future<cv::Mat> still = std::async(std::launch::deferred, render, 0);
    const auto light = [&, render, still, c](size_t frame) -> cv::Mat {
      const cv::Mat nominal = spec.poses.still ? still.get() : render(frame);
      if (scene.exposures.empty()) return nominal;
      return nominal * (scene.exposures[c][frame].exact / spec.exposures->nominal);
    };
    std::ranges::move(
        ListCameraImages(spec, c, *renderers[c], FrameNames(scene), light, spec.white_images),
        std::back_inserter(tasks));
  }
  return tasks;
}

// The recording, for photometric calibration.
void WriteExposures(const Scene& scene, OutputFolder* out) {
  const std::vector<std::string> names = FrameNames(scene);
  for (size_t c = 0; c < scene.spec.cameras.size(); ++c) {
    out->Write(fmt::format("times_{}.txt", scene.spec.cameras[c].name),
               ExposureTimesText(names, scene.exposures[c], scene.spec.exposures->known));
  }
  out->Write("recording.yaml", PhotometryRecordingYaml(scene.spec));
  out->Write("truth/exposures.csv", TrueExposuresCsv(scene.spec, names, scene.exposures));
}

// Times that the images state.
void WriteTimes(const Scene& scene, OutputFolder* out) {
  for (const CameraSpec& camera : scene.spec.cameras) {
    std::string text = "# frame, s\n";
    for (const Frame& frame : scene.frames) {
      text += fmt::format("{} {:.9f}\n", frame.name, frame.time + camera.time_offset);
    }
    out->Write(fmt::format("times_{}.txt", camera.name), text);
  }
}

void WriteDetections(const Scene& scene, OutputFolder* out) {
  for (size_t c = 0; c < scene.spec.cameras.size(); ++c) {
    const CameraSpec& camera = scene.spec.cameras[c];
    out->Write(fmt::format("detections_{}.csv", camera.name),
               DetectionsCsv(WithNoise(scene.views[c], camera, c, scene.spec.seed), *camera.model));
  }
}

std::string Summary(const Scene& scene) {
  std::string summary;
  for (size_t c = 0; c < scene.spec.cameras.size(); ++c) {
    const CameraSpec& camera = scene.spec.cameras[c];
    const auto frames = std::ranges::count_if(
        scene.views[c], [](const View& view) { return !view.observations.empty(); });
    summary += fmt::format("{}: the target in {} of {}{}\n",
                           camera.name,
                           frames,
                           Counted(scene.frames.size(), "frame"),
                           camera.micro_lenses ? VirtualDepthText(scene.views[c], camera) : "");
  }
  return summary;
}

}  // namespace
}  // namespace simulate

std::string Simulate(const SimulateRequest& request, const SimulateOptions& options) {
  using namespace simulate;  // NOLINT(google-build-using-namespace)
  const Progress progress = [&](const std::string& stage, size_t done, size_t total) {
    if (options.progress && !options.progress(stage, done, total)) throw Stopped{};
  };
  Scene scene;
  scene.spec = ReadSimulationSpec(request.spec, options.models);
  const SimulationSpec& spec = scene.spec;
  if (spec.scenery) return SimulateScene(spec, request, options, progress);
  scene.targets = MakeTargets(spec);
  scene.target = StatedTogether(scene.targets);
  scene.made = Together(scene.targets);
  OutputFolder out(request.out);
  out.RefuseInputs({"session.yaml", "target.yaml"});
  const Observer observer(spec);
  ObserveScene(observer, options.threads, progress, &scene);
  if (spec.exposures) scene.exposures = DrawExposures(spec, scene.frames.size());
  if (spec.wall) scene.texture.emplace(spec.wall->structure, spec.seed);
  Renderers renderers(spec.cameras.size());
  if (request.points) {
    WriteDetections(scene, &out);
  } else {
    const TargetSurface surface = JoinSurfaces(scene.targets, spec.seed);
    progress("optics", 0, 1);
    renderers = MakeRenderers(spec, observer, options.threads);
    WriteImages(
        ListImages(scene, surface, renderers), request.out, options.threads, progress, &out);
    if (spec.exposures) WriteExposures(scene, &out);
  }
  if (spec.poses.moving) WriteTimes(scene, &out);
  out.Write("session.yaml", SessionYaml(scene, request));
  for (const TargetInRoom& target : scene.targets) {
    out.Write(TargetFile(target), RefinedTargetYaml(target.target, {}, {}));
  }
  WriteTruth(scene, observer, renderers, request, options.program, &out);
  out.Commit();
  return Summary(scene);
}

}  // namespace plenocal
