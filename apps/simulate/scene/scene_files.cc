// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/scene/scene_files.h"

#include <fmt/format.h>

#include <algorithm>

#include "apps/simulate/spec/random.h"
#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "calib/files/calibration_tables.h"

namespace plenocal::simulate {
namespace {

// Standard deviation of a parameter's error in the given calibration.
double FindSigma(const CalibrationSigma& sigma, const CameraSpec& camera, const Param& param) {
  const auto of_camera = sigma.parameters.find(camera.name);
  if (of_camera != sigma.parameters.end()) {
    const auto found = of_camera->second.find(std::string(param.name));
    if (found != of_camera->second.end()) return found->second;
  }
  return param.unit == "px" ? sigma.focal : 0;
}

void Perturb(const SimulationSpec& spec, size_t c, CalibratedCamera* camera) {
  const CalibrationSigma& sigma = spec.scenery->calibration_sigma;
  Random random(spec.seed, "calibration", {c});
  for (size_t i = 0; i < camera->params.size(); ++i) {
    const double s = FindSigma(sigma, spec.cameras[c], camera->model->params[i]);
    camera->params[i] += random.Gaussian(s);
    const auto at = static_cast<Eigen::Index>(i);
    camera->covariance(at, at) = s * s;
  }
  if (c == 0) return;  // the rig's frame
  camera->sigma_xi << Eigen::Vector3d::Constant(sigma.baseline),
      Eigen::Vector3d::Constant(sigma.rotation);
  Vector6d xi = Log(camera->T_camera_rig);
  for (int i = 0; i < 6; ++i) xi[i] += random.Gaussian(camera->sigma_xi[i]);
  camera->T_camera_rig = Exp(xi);
}

}  // namespace

std::string RecordingYaml(const SimulationSpec& spec, bool points) {
  std::string text = "plenocal: 1\ncameras:\n";
  for (const CameraSpec& camera : spec.cameras) {
    text += fmt::format("  {}:\n{}    times: times.txt\n    exposure_unit: ms\n{}",
                        YamlText(camera.name),
                        points ? fmt::format("    tracks: tracks_{}.csv\n", camera.name)
                               : ImageKeys(camera, camera.IsPlenoptic()) + BayerKey(camera),
                        ConfigKeys(camera));
  }
  return text + "pairing: {by: name}\ncalibration: calibration.yaml\n";
}

std::string SceneSessionYaml(const SimulationSpec& spec,
                             bool points,
                             const std::vector<std::string>& distances) {
  std::string text = fmt::format("plenocal: 1\nscene:\n  points: {}\n", spec.scenery->scene.points);
  if (!distances.empty()) text += "  distances:\n";
  for (const std::string& distance : distances) text += "    - " + distance + "\n";
  text += "cameras:\n";
  for (const CameraSpec& camera : spec.cameras) {
    text += ModelKeys(camera);
    text += points ? DetectionKeys(camera, fmt::format("tracks_{}.csv", camera.name))
                   : ImageKeys(camera, camera.IsPlenoptic()) + BayerKey(camera);
    text += ConfigKeys(camera);
  }
  return text;
}

std::string TimesText(const RigPath& path) {
  constexpr double kExposure = 5;  // ms
  std::string text = "# frame time_s exposure_ms\n";
  for (const RigInstant* instant : path.Used()) {
    text += fmt::format("{} {:.6f} {}\n", instant->name, instant->time, kExposure);
  }
  return text;
}

CalibrationRecord GivenRecord(const SimulationSpec& spec) {
  CalibrationRecord record = TrueRecord(spec);
  for (size_t c = 0; c < record.cameras.size(); ++c) Perturb(spec, c, &record.cameras[c]);
  return record;
}

std::string TrajectoryText(const RigPath& path, const CameraSpec& camera, PathExtent extent) {
  const RigidTransform T_rig_camera = camera.T_camera_rig.Inverse();
  std::string text = "# time x y z qx qy qz qw\n";
  for (const RigInstant& instant : path.instants) {
    if (extent == PathExtent::kSegments && instant.part == Part::kBetween) continue;
    const RigidTransform T = instant.T_world_rig * T_rig_camera;
    const Eigen::Quaterniond q(T.R);
    text += fmt::format("{:.6f}", instant.time);
    for (const double value : {T.t.x(), T.t.y(), T.t.z(), q.x(), q.y(), q.z(), q.w()}) {
      text += fmt::format(" {:.12g}", value + 0.0);
    }
    text += '\n';
  }
  return text;
}

std::string PathPosesCsv(const RigPath& path) {
  CalibrationRecord record;
  for (const RigInstant* instant : path.Used()) {
    record.frames.push_back({instant->name, instant->T_world_rig});
  }
  return PosesCsv(record);
}

std::string PointsCsv(const std::vector<ScenePoint>& points) {
  std::string text = "marker,x,y,z\n";
  const auto add = [&](int number, const Eigen::Vector3d& p) {
    text += fmt::format("{},{:.12g},{:.12g},{:.12g}\n", number, p.x(), p.y(), p.z());
  };
  for (const ScenePoint& point : points) {
    if (point.box) continue;
    add(point.number, point.position);
    // A number that a copy of the point has as well stands there with the copy's position.
    const bool is_own = point.number_at_end && *point.number_at_end != point.number &&
                        std::ranges::none_of(points, [&](const ScenePoint& other) {
                          return other.number == *point.number_at_end;
                        });
    if (is_own) add(*point.number_at_end, point.position);
  }
  return text;
}

std::string MovingCsv(const std::vector<ScenePoint>& points) {
  std::string text = "marker,box\n";
  for (const ScenePoint& point : points) {
    if (!point.box) continue;
    text += fmt::format("{},{}\n", point.number, *point.box);
    if (point.number_at_end && *point.number_at_end != point.number) {
      text += fmt::format("{},{}\n", *point.number_at_end, *point.box);
    }
  }
  return text;
}

std::string WrongMatchesCsv(const CameraTracks& tracks) {
  std::string text = "frame,marker\n";
  for (const auto& [frame, marker] : tracks.wrong) text += fmt::format("{},{}\n", frame, marker);
  return text;
}

std::vector<std::string> DrawDistances(const SimulationSpec& spec,
                                       const std::vector<ScenePoint>& points,
                                       const std::vector<int>& observed) {
  const SceneSpec& scene = spec.scenery->scene;
  constexpr int kOften = 10;  // observations, so that both points are well known
  std::vector<const ScenePoint*> known;
  for (size_t i = 0; i < points.size(); ++i) {
    if (!points[i].box && observed[i] >= kOften) known.push_back(&points[i]);
  }
  std::vector<std::string> lines;
  if (scene.distances > 0 && known.size() < 2) {
    throw JobError(
        "{}: scene.distances: no two points are seen in {} images; give more "
        "frames or points",
        spec.path.string(),
        kOften);
  }
  for (int k = 0; k < scene.distances; ++k) {
    // The longest of some, as a person would measure.
    constexpr int kPairs = 20;
    Random random(spec.seed, "distance", {static_cast<size_t>(k)});
    const auto draw = [&] {
      return known[std::min(
          known.size() - 1,
          static_cast<size_t>(random.Uniform(0, static_cast<double>(known.size()))))];
    };
    const ScenePoint *a = known[0], *b = known[0];
    const auto length = [](const ScenePoint* from, const ScenePoint* to) {
      return (from->position - to->position).norm();
    };
    for (int i = 0; i < kPairs; ++i) {
      const ScenePoint *from = draw(), *to = draw();
      if (length(from, to) > length(a, b)) a = from, b = to;
    }
    lines.push_back(fmt::format("{{between: [point {}, point {}], value: {:.6f}, sigma: {}}}",
                                a->number,
                                b->number,
                                length(a, b) + random.Gaussian(scene.distance_sigma),
                                YamlNumber(scene.distance_sigma)));
  }
  return lines;
}

}  // namespace plenocal::simulate
