// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/spec/scene_spec.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <numbers>

#include "apps/simulate/spec/spec_values.h"

namespace plenocal::simulate {
namespace {

// The words of `kind`; `far`: the scene is far away.
void ReadKinds(const YamlNode& trajectory, TrajectorySpec* spec, bool* far) {
  if (!trajectory.Has("kind")) return;
  const YamlNode kind = trajectory.At("kind");
  bool loop = false, handheld = false;
  ReadFlags(kind,
            std::to_array<SpecFlag>({{"loop", &loop},
                                     {"handheld", &handheld},
                                     {"straight", &spec->straight},
                                     {"far", far},
                                     {"rotation", &spec->rotation},
                                     {"one-depth", &spec->one_depth},
                                     {"no-turning", &spec->no_turning},
                                     {"no-overlap", &spec->no_overlap},
                                     {"repeated", &spec->repeated}}),
            "'loop' or 'handheld'");
  if (loop && handheld) kind.Fail("give either 'loop' or 'handheld'");
  if (handheld) {
    spec->shape = TrajectorySpec::Shape::kHandheld;
    if (spec->straight) kind.Fail("'straight' goes with 'loop' only");
    if (spec->no_overlap) kind.Fail("'no-overlap' goes with 'loop' only");
    if (spec->repeated) kind.Fail("'repeated' goes with 'loop' only");
  }
  if (spec->no_turning && !handheld) kind.Fail("'no-turning' goes with 'handheld' only");
  if (spec->repeated && (spec->straight || spec->rotation)) {
    kind.Fail("'repeated' goes with neither 'straight' nor 'rotation'");
  }
  if (spec->rotation && (spec->no_turning || spec->straight)) {
    kind.Fail("'rotation' goes with neither 'straight' nor 'no-turning'");
  }
}

void CheckLoop(const YamlNode& node, const TrajectorySpec& spec) {
  const double segment = spec.segment * spec.speed;
  const YamlNode& place = node.Has("length") ? node.At("length") : node;
  if (!(spec.length >= 2 * segment)) {
    place.Fail(
        fmt::format("{} m are walked in {:.4g} s: shorter than a start and an end of {:.4g} s each",
                    spec.length,
                    spec.length / spec.speed,
                    spec.segment));
  }
  // Half circles of a radius of 0.5 m join the straight sides.
  const double least = (2 + spec.overlap) * segment + std::numbers::pi;
  if (spec.straight && !(spec.length >= least)) {
    place.Fail(fmt::format("a straight start and end need a path of at least {:.4g} m", least));
  }
}

void ReadTrajectorySpec(const YamlNode& node,
                        const std::filesystem::path& path,
                        TrajectorySpec* spec) {
  const SpecKey segment{"segment", &spec->segment, 0.01, 1e5};
  const SpecKey frames{"frames", &spec->frames, 2, 1e6}, whole{"whole", &spec->whole};
  if (node.Has("file")) {
    spec->shape = TrajectorySpec::Shape::kGiven;
    ReadKeys(node, {segment, frames, whole}, {"file"});
    spec->given = ReadTrajectory(PathBeside(path, node.At("file")), {});
    return;
  }
  ReadKeys(node,
           {{"length", &spec->length, 1, 1e5},
            {"speed", &spec->speed, 0.01, 100},
            {"rate", &spec->rate, 0.1, 10000},
            segment,
            {"overlap", &spec->overlap, 0, 1},
            {"shake", &spec->shake, 0, 10},
            {"turn", &spec->turn, 0, std::numbers::pi},
            {"roll", &spec->roll, 0, std::numbers::pi},
            frames,
            whole},
           {"kind", "winding"});
  if (node.Has("winding")) {
    ReadKeys(node.At("winding"),
             {{"amplitude", &spec->amplitude, 0, 100}, {"seconds", &spec->seconds, 0.1, 1e4}});
  }
  if (spec->shape == TrajectorySpec::Shape::kLoop) CheckLoop(node, *spec);
  if (spec->shape == TrajectorySpec::Shape::kHandheld) static_cast<void>(node.At("frames"));
}

void ReadSceneSpec(const YamlNode& node, SceneSpec* scene) {
  ReadKeys(node,
           {{"points", &scene->points, 1, 1e7},
            {"near", &scene->nearest, 1e-3, 1e5},
            {"far", &scene->farthest, 1e-3, 1e5},
            {"boxes", &scene->boxes, 0, 100000},
            {"moving", &scene->moving, 0, 0.9},
            {"track_length", &scene->track_length, 1, 1e9},
            {"wrong_matches", &scene->wrong_matches, 0, 0.9},
            {"merged", &scene->merged, 0, 1},
            {"distances", &scene->distances, 0, 1000},
            {"distance_sigma", &scene->distance_sigma, 1e-9, 10}});
  if (!(scene->farthest > scene->nearest)) {
    const YamlNode place = node.Has("far") ? node.At("far") : node;
    place.Fail(fmt::format(
        "'far' ({} m) must be greater than 'near' ({} m)", scene->farthest, scene->nearest));
  }
}

void ReadCalibrationSigma(const YamlNode& node, CalibrationSigma* sigma) {
  ReadKeys(node,
           {{"baseline", &sigma->baseline, 0, 1},
            {"rotation", &sigma->rotation, 0, 1},
            {"focal", &sigma->focal, 0, 1000}},
           {"parameters"});
  if (!node.Has("parameters")) return;
  // The reader of the cameras checks that cameras and parameters of these names exist.
  for (const auto& [camera, entries] : node.At("parameters").Entries()) {
    for (const auto& [name, value] : entries.Entries()) {
      sigma->parameters[camera][name] = NumberWithin(value, 0, 1e12);
    }
  }
}

}  // namespace

ScenerySpec ReadScenery(const YamlNode& root, const std::filesystem::path& path) {
  ScenerySpec spec;
  const YamlNode trajectory = root.At("trajectory");
  TrajectorySpec& motion = spec.trajectory;
  bool far = false;
  ReadKinds(trajectory, &motion, &far);
  if (far) {
    spec.scene.nearest = 25;
    spec.scene.farthest = 80;
  }
  ReadTrajectorySpec(trajectory, path, &motion);
  ReadSceneSpec(root.At("scene"), &spec.scene);
  if (motion.one_depth) {
    constexpr double kThickness = 0.05;  // of the depth, to both sides
    const double depth = std::sqrt(spec.scene.nearest * spec.scene.farthest);
    spec.scene.nearest = (1 - kThickness) * depth;
    spec.scene.farthest = (1 + kThickness) * depth;
    spec.scene.boxes = 0;
  }
  if (root.Has("calibration_sigma")) {
    ReadCalibrationSigma(root.At("calibration_sigma"), &spec.calibration_sigma);
  }
  return spec;
}

}  // namespace plenocal::simulate
