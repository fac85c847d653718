// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/simulate.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <functional>
#include <iterator>
#include <map>
#include <memory>
#include <mutex>
#include <set>

#include "apps/simulate/observer.h"
#include "apps/simulate/pose_set.h"
#include "apps/simulate/provenance.h"
#include "apps/simulate/random.h"
#include "apps/simulate/renderer.h"
#include "apps/simulate/scene/simulate_scene.h"
#include "apps/simulate/sensor.h"
#include "apps/simulate/simulation_spec.h"
#include "apps/simulate/target_surface.h"
#include "calib/base/error.h"
#include "calib/base/number_text.h"
#include "calib/base/output_folder.h"
#include "calib/base/parallel.h"
#include "calib/base/quoted_text.h"
#include "calib/files/calibration_file.h"
#include "calib/files/calibration_tables.h"
#include "calib/files/detections.h"
#include "detectors/images/image.h"

namespace plenocal {
namespace simulate {
namespace {

// The simulated world, without errors of measurement.
struct Scene {
  SimulationSpec spec;
  Target target;
  TrueTarget made;
  std::vector<Frame> frames;
  std::vector<std::vector<View>> views;  // exact; by camera and frame
};

std::string SessionYaml(const Scene& scene, const SimulateRequest& request) {
  std::string text = "plenocal: 1\ntarget: target.yaml\ncameras:\n";
  const auto out = std::back_inserter(text);
  for (const CameraSpec& camera : scene.spec.cameras) {
    fmt::format_to(out, "  {}:\n    model: {}\n", YamlText(camera.name), camera.model->name);
    if (request.points) {
      fmt::format_to(out,
                     "    detections: detections_{}.csv\n    image_size: [{}, {}]\n",
                     camera.name,
                     camera.image_size[0],
                     camera.image_size[1]);
    } else {
      fmt::format_to(
          out, "    images: {0}/*.png\n    white_images: {0}_white/*.png\n", camera.name);
      if (camera.sensor.bayer) {
        fmt::format_to(out, "    bayer: {}\n", BayerName(*camera.sensor.bayer));
      }
    }
    for (size_t i = 0; i < camera.config.size(); ++i) {
      fmt::format_to(
          out, "    {}: {}\n", camera.model->config[i].name, YamlNumber(camera.config[i]));
    }
  }
  return text;
}

// The truth as the result of a calibration without errors.
CalibrationRecord TrueCalibration(const Scene& scene) {
  CalibrationRecord truth;
  truth.adjustment = AdjustmentRecord{.converged = true};
  for (size_t c = 0; c < scene.spec.cameras.size(); ++c) {
    truth.cameras.push_back(TrueCamera(scene.spec.cameras[c]));
    CameraFit& fit = truth.cameras.back().fit;
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
      fmt::format_to(std::back_inserter(text), ",{}", CountMarkers(views[f].observations));
    }
    text += '\n';
  }
  return text;
}

using Renderers = std::vector<std::unique_ptr<Renderer>>;

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
    out->Write(fmt::format("truth/detections_{}.csv", name),
               DetectionsCsv(scene.views[c], *scene.spec.cameras[c].model));
  }
  truth.provenance = SimulationProvenance(request, program, kTrueParameters);
  out->Write("truth/calibration.yaml", CalibrationYaml(truth));
  out->Write("truth/target.yaml", RefinedTargetYaml(scene.target, scene.made.markers, {}));
  out->Write("truth/poses.csv", PosesCsv(truth));
  out->Write("truth/frames.csv", FramesCsv(scene));
}

// An image of the session that is to be made.
struct Shot {
  size_t camera = 0;
  std::optional<size_t> frame;  // none: of the white field
  size_t index = 0;             // of the white image
  std::string name;
};

std::vector<Shot> ListShots(const Scene& scene) {
  std::vector<Shot> shots;
  for (size_t c = 0; c < scene.spec.cameras.size(); ++c) {
    const std::string& camera = scene.spec.cameras[c].name;
    for (size_t f = 0; f < scene.frames.size(); ++f) {
      shots.push_back({c, f, 0, fmt::format("{}/{}.png", camera, scene.frames[f].name)});
    }
    for (size_t i = 0; i < static_cast<size_t>(scene.spec.white_images); ++i) {
      shots.push_back({c, std::nullopt, i, fmt::format("{}_white/white_{:02}.png", camera, i)});
    }
  }
  // The slow ones first, so that all threads end at about the same time.
  std::stable_sort(shots.begin(), shots.end(), [&](const Shot& a, const Shot& b) {
    const auto is_slow = [&](const Shot& shot) {
      return shot.frame && scene.spec.cameras[shot.camera].IsPlenoptic();
    };
    return is_slow(a) && !is_slow(b);
  });
  return shots;
}

// Images of another run would become part of the session.
void RefuseOtherImages(const std::vector<Shot>& shots, const std::filesystem::path& out) {
  std::set<std::filesystem::path> expected, folders;
  for (const Shot& shot : shots) {
    expected.insert(out / shot.name);
    folders.insert((out / shot.name).parent_path());
  }
  for (const std::filesystem::path& folder : folders) {
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
      if (entry.path().extension() != ".png" || expected.contains(entry.path())) continue;
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: is no image of this session but would be taken for one; remove "
                              "it or give another folder with -o",
                              entry.path().string()));
    }
  }
}

cv::Mat TakeShot(const Scene& scene,
                 const TargetSurface& surface,
                 const Renderer& renderer,
                 const Shot& shot) {
  const CameraSpec& camera = scene.spec.cameras[shot.camera];
  if (!shot.frame) {
    Random random(scene.spec.seed, "white", {shot.camera, shot.index});
    constexpr double kFlicker = 0.01;  // of the lamp
    return Expose(renderer.White() * (1 + random.Gaussian(kFlicker)), camera.sensor, &random);
  }
  Random random(scene.spec.seed, "image", {shot.camera, *shot.frame});
  const PosedSurface posed(surface, camera.T_camera_rig * scene.frames[*shot.frame].T_rig_target);
  const std::uint64_t sampling =
      static_cast<std::uint64_t>(scene.spec.seed) * 1000003 + shot.camera * 65537 + *shot.frame;
  return Expose(renderer.Render(posed, sampling), camera.sensor, &random);
}

std::vector<View> WithNoise(std::vector<View> views, const CameraSpec& camera, size_t c, int seed) {
  for (size_t f = 0; f < views.size(); ++f) {
    Random random(seed, "detections", {c, f});
    for (Observation& observation : views[f].observations) {
      for (size_t i = 0; i < camera.model->measured.size(); ++i) {
        observation.values[i] += random.Gaussian(camera.detection_sigma);
      }
      observation.detector_sigma = camera.detection_sigma;
    }
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
      if (seen.size() > 1) depths.push_back(1 / (1 - x.dot(centre) / centre.squaredNorm()));
    }
  }
  if (depths.empty()) return {};
  const auto [least, greatest] = std::minmax_element(depths.begin(), depths.end());
  return fmt::format(", at virtual depths from {:.2f} to {:.2f} (sharp: {:.4g})",
                     *least,
                     *greatest,
                     fmt::join(camera.micro_lenses->focus, ", "));
}

using Progress = std::function<void(const std::string& stage, size_t done, size_t total)>;

// Everything but the images: target, poses and exact observations.
void ObserveScene(const Observer& observer, int threads, const Progress& progress, Scene* scene) {
  const SimulationSpec& spec = scene->spec;
  progress("poses", 0, 1);
  scene->frames = MakePoses(spec, observer, scene->made);
  scene->views.resize(spec.cameras.size());
  for (size_t c = 0; c < spec.cameras.size(); ++c) {
    scene->views[c].resize(scene->frames.size());
    ParallelFor(scene->frames.size(), threads, [&](size_t f) {
      const Frame& frame = scene->frames[f];
      scene->views[c][f] = {frame.name, observer.Observe(c, scene->made, frame.T_rig_target)};
    });
    progress("markers", c + 1, spec.cameras.size());
  }
}

// Renders and writes all images; returns the renderers by camera.
Renderers WriteImages(const Scene& scene,
                      const Observer& observer,
                      int threads,
                      const Progress& progress,
                      OutputFolder* out) {
  const SimulationSpec& spec = scene.spec;
  const std::vector<Shot> shots = ListShots(scene);
  progress("optics", 0, 1);
  Renderers renderers;
  for (size_t c = 0; c < spec.cameras.size(); ++c) {
    const MicroLensOptics* optics = observer.Optics(c);
    renderers.push_back(optics == nullptr
                            ? MakeOrdinaryRenderer(spec.cameras[c])
                            : MakePlenopticRenderer(spec.cameras[c], *optics, spec.seed, threads));
  }
  const TargetSurface surface(NominalTarget(scene.target), scene.made, spec.seed);
  std::mutex mutex;
  size_t done = 0;
  ParallelFor(shots.size(), threads, [&](size_t i) {
    const std::string file =
        EncodeImage(".png", TakeShot(scene, surface, *renderers[shots[i].camera], shots[i]));
    const std::lock_guard lock(mutex);
    out->Write(shots[i].name, file);
    progress("images", ++done, shots.size());
  });
  return renderers;
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
  scene.target = ReadTarget(spec.target);
  OutputFolder out(request.out);
  out.RefuseInputs({"session.yaml", "target.yaml"});
  const Observer observer(spec);
  scene.made = MakeTarget(scene.target,
                          spec.target_error.value_or(scene.target.tolerance.value_or(0)),
                          spec.rigid_tags ? TagErrors::kRigid : TagErrors::kCorners,
                          spec.seed);
  ObserveScene(observer, options.threads, progress, &scene);
  Renderers renderers(spec.cameras.size());
  if (request.points) {
    WriteDetections(scene, &out);
  } else {
    RefuseOtherImages(ListShots(scene), request.out);
    renderers = WriteImages(scene, observer, options.threads, progress, &out);
  }
  out.Write("session.yaml", SessionYaml(scene, request));
  out.Write("target.yaml", RefinedTargetYaml(scene.target, {}, {}));
  WriteTruth(scene, observer, renderers, request, options.program, &out);
  out.Commit();
  return Summary(scene);
}

}  // namespace plenocal
