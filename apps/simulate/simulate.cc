// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/simulate.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <iterator>
#include <map>
#include <memory>
#include <mutex>
#include <opencv2/imgcodecs.hpp>
#include <set>

#include "apps/simulate/observer.h"
#include "apps/simulate/pose_set.h"
#include "apps/simulate/random.h"
#include "apps/simulate/renderer.h"
#include "apps/simulate/sensor.h"
#include "apps/simulate/simulation_spec.h"
#include "apps/simulate/target_surface.h"
#include "calib/detections.h"
#include "calib/error.h"
#include "calib/number_text.h"
#include "calib/output_folder.h"
#include "calib/parallel.h"
#include "calib/result_files.h"

namespace plenocal {
namespace simulate {
namespace {

// All that is known before anything is measured.
struct Scene {
  SimulationSpec spec;
  Target target;
  TrueTarget made;
  std::vector<Frame> frames;
  std::vector<std::vector<View>> views;  // exact; by camera and frame
};

std::string SessionYaml(const Scene& scene, bool points) {
  std::string text = "plenocal: 1\ntarget: target.yaml\ncameras:\n";
  const auto out = std::back_inserter(text);
  for (const CameraSpec& camera : scene.spec.cameras) {
    fmt::format_to(out, "  {}:\n    model: {}\n", camera.name, camera.model->name);
    if (points) {
      fmt::format_to(out,
                     "    detections: detections_{}.csv\n    image_size: [{}, {}]\n",
                     camera.name,
                     camera.image_size[0],
                     camera.image_size[1]);
    } else {
      fmt::format_to(
          out, "    images: {0}/*.png\n    white_images: {0}_white/*.png\n", camera.name);
      if (!camera.sensor.bayer.empty()) fmt::format_to(out, "    bayer: {}\n", camera.sensor.bayer);
    }
    for (size_t i = 0; i < camera.config.size(); ++i) {
      fmt::format_to(
          out, "    {}: {}\n", camera.model->config[i].name, YamlNumber(camera.config[i]));
    }
  }
  return text;
}

// The truth as a calibration without errors.
Calibration TrueCalibration(const Scene& scene) {
  Calibration truth;
  truth.converged = true;
  for (size_t c = 0; c < scene.spec.cameras.size(); ++c) {
    const CameraSpec& camera = scene.spec.cameras[c];
    truth.camera_names.push_back(camera.name);
    truth.image_sizes.push_back(camera.image_size);
    truth.bundle.cameras.push_back({.model = camera.model,
                                    .config = camera.config,
                                    .params = camera.params,
                                    .fixed = std::vector<bool>(camera.params.size(), false),
                                    .T_camera_rig = camera.T_camera_rig,
                                    .is_master = c == 0});
    truth.uncertainty.params.emplace_back(camera.params.size(), 0.0);
    truth.uncertainty.mount.emplace_back(Matrix6d::Zero());
    CameraFit fit;
    for (const View& view : scene.views[c]) {
      fit.points += static_cast<int>(view.observations.size());
      fit.views += view.observations.empty() ? 0 : 1;
    }
    truth.fits.push_back(fit);
  }
  for (const Frame& frame : scene.frames) {
    truth.frames.push_back(frame.name);
    truth.bundle.T_rig_target.push_back(frame.T_rig_target);
  }
  return truth;
}

std::string FramesCsv(const Scene& scene) {
  std::string text = "frame,kind";
  for (const CameraSpec& camera : scene.spec.cameras) text += ",markers_" + camera.name;
  text += '\n';
  for (size_t f = 0; f < scene.frames.size(); ++f) {
    text += scene.frames[f].name + "," + scene.frames[f].kind;
    for (const auto& views : scene.views) {
      fmt::format_to(std::back_inserter(text), ",{}", CountMarkers(views[f].observations));
    }
    text += '\n';
  }
  return text;
}

using Renderers = std::vector<std::unique_ptr<Renderer>>;

std::string Encoded(const cv::Mat& image, const char* extension) {
  std::vector<unsigned char> bytes;
  if (!cv::imencode(extension, image, bytes)) {
    throw Error(ErrorKind::kJob, fmt::format("OpenCV cannot write {} images", extension));
  }
  return {bytes.begin(), bytes.end()};
}

void WriteTruth(const Scene& scene,
                const Observer& observer,
                const Renderers& renderers,
                const SimulateCommand& command,
                const std::string& program,
                OutputFolder* out) {
  Calibration truth = TrueCalibration(scene);
  truth.camera_files.resize(scene.spec.cameras.size());
  for (size_t c = 0; c < scene.spec.cameras.size(); ++c) {
    const std::string& name = scene.spec.cameras[c].name;
    if (const MicroLensOptics* optics = observer.Optics(c)) {
      const std::string file = fmt::format("micro_lenses_{}.csv", name);
      truth.camera_files[c].emplace_back("micro_lenses", file);
      out->Write("truth/" + file, FormatMicroLenses(optics->Array()));
    }
    if (renderers[c]) {
      const std::string file = fmt::format("vignetting_{}.tiff", name);
      truth.camera_files[c].emplace_back("vignetting", file);
      out->Write("truth/" + file, Encoded(renderers[c]->White(), ".tiff"));
    }
    out->Write(fmt::format("truth/detections_{}.csv", name),
               DetectionsCsv(scene.views[c], *scene.spec.cameras[c].model));
  }
  out->Write("truth/calibration.yaml",
             CalibrationYaml(truth,
                             {{"plenocal_version", PLENOCAL_VERSION},
                              {"command",
                               fmt::format("{} simulate {} -o {}{}",
                                           program,
                                           command.spec.string(),
                                           command.out.string(),
                                           command.points ? " --points" : "")},
                              {"simulation", "the parameters are true, not estimated"}}));
  out->Write("truth/target.yaml", RefinedTargetYaml(scene.target, scene.made.markers, {}));
  out->Write("truth/poses.csv", PosesCsv(truth));
  out->Write("truth/frames.csv", FramesCsv(scene));
}

// The session must not take the place of what it is made from.
void RefuseToReplaceInputs(const SimulateCommand& command, const SimulationSpec& spec) {
  for (const std::filesystem::path& input : {command.spec, spec.target}) {
    for (const char* result : {"session.yaml", "target.yaml"}) {
      std::error_code error;
      if (!std::filesystem::equivalent(input, command.out / result, error)) continue;
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: the session would replace this input; give another folder with "
                              "-o",
                              input.string()));
    }
  }
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
      observation.sigma = camera.detection_sigma;
    }
  }
  return views;
}

// Between which virtual depths the markers were, for whoever chooses where lens types are sharp.
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

}  // namespace
}  // namespace simulate

std::string Simulate(const SimulateCommand& command, const SimulateOptions& options) {
  using namespace simulate;  // NOLINT(google-build-using-namespace)
  const auto progress = [&](const std::string& stage, size_t done, size_t total) {
    if (options.progress && !options.progress(stage, done, total)) throw Stopped{};
  };
  Scene scene;
  scene.spec = ReadSimulationSpec(command.spec, options.models);
  const SimulationSpec& spec = scene.spec;
  scene.target = ReadTarget(spec.target);
  RefuseToReplaceInputs(command, spec);
  OutputFolder out(command.out);
  const Observer observer(spec);
  scene.made = MakeTarget(scene.target,
                          spec.target_error.value_or(scene.target.tolerance.value_or(0)),
                          spec.rigid_tags,
                          spec.seed);
  progress("poses", 0, 1);
  scene.frames = MakePoses(spec, observer, scene.made);
  scene.views.resize(spec.cameras.size());
  for (size_t c = 0; c < spec.cameras.size(); ++c) {
    scene.views[c].resize(scene.frames.size());
    ParallelFor(scene.frames.size(), options.threads, [&](size_t f) {
      scene.views[c][f] = {scene.frames[f].name,
                           observer.Observe(c, scene.made, scene.frames[f].T_rig_target)};
    });
    progress("markers", c + 1, spec.cameras.size());
  }

  Renderers renderers(spec.cameras.size());
  if (!command.points) {
    const std::vector<Shot> shots = ListShots(scene);
    RefuseOtherImages(shots, command.out);
    progress("optics", 0, 1);
    for (size_t c = 0; c < spec.cameras.size(); ++c) {
      const MicroLensOptics* optics = observer.Optics(c);
      renderers[c] = optics == nullptr ? MakeOrdinaryRenderer(spec.cameras[c])
                                       : MakePlenopticRenderer(
                                             spec.cameras[c], *optics, spec.seed, options.threads);
    }
    const TargetSurface surface(NominalTarget(scene.target), scene.made, spec.seed);
    std::mutex mutex;
    size_t done = 0;
    ParallelFor(shots.size(), options.threads, [&](size_t i) {
      const std::string file =
          Encoded(TakeShot(scene, surface, *renderers[shots[i].camera], shots[i]), ".png");
      const std::lock_guard lock(mutex);
      out.Write(shots[i].name, file);
      progress("images", ++done, shots.size());
    });
  }
  out.Write("session.yaml", SessionYaml(scene, command.points));
  out.Write("target.yaml", RefinedTargetYaml(scene.target, {}, {}));
  WriteTruth(scene, observer, renderers, command, options.program, &out);
  std::string summary;
  for (size_t c = 0; c < spec.cameras.size(); ++c) {
    const CameraSpec& camera = spec.cameras[c];
    const auto frames = std::count_if(scene.views[c].begin(),
                                      scene.views[c].end(),
                                      [](const View& view) { return !view.observations.empty(); });
    if (command.points) {
      out.Write(fmt::format("detections_{}.csv", camera.name),
                DetectionsCsv(WithNoise(scene.views[c], camera, c, spec.seed), *camera.model));
    }
    summary += fmt::format("{}: the target in {} of {} frames{}\n",
                           camera.name,
                           frames,
                           scene.frames.size(),
                           camera.micro_lenses ? VirtualDepthText(scene.views[c], camera) : "");
  }
  out.Commit();
  return summary;
}

}  // namespace plenocal
