// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/scene/scene_spec.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "apps/simulate/spec_values.h"

namespace plenocal::simulate {
namespace {

enum Kind : std::size_t {
  kLoop,
  kHandheld,
  kStraight,
  kFar,
  kRotation,
  kOneDepth,
  kNoTurning,
  kNoOverlap,
  kRepeated,
  kKinds
};
using Kinds = std::array<bool, kKinds>;

Kinds ReadKinds(const YamlNode& trajectory) {
  static constexpr std::array<std::string_view, kKinds> kNames{"loop",
                                                               "handheld",
                                                               "straight",
                                                               "far",
                                                               "rotation",
                                                               "one-depth",
                                                               "no-turning",
                                                               "no-overlap",
                                                               "repeated"};
  Kinds chosen{};
  if (!trajectory.Has("kind")) return chosen;
  const YamlNode kind = trajectory.At("kind");
  for (const YamlNode& item : kind.IsSequence() ? kind.Elements() : std::vector{kind}) {
    chosen[ReadChoice(item, kNames)] = true;
  }
  if (chosen == Kinds{}) kind.Fail("the list is empty; write 'loop' or 'handheld'");
  if (chosen[kLoop] && chosen[kHandheld]) kind.Fail("give either 'loop' or 'handheld'");
  for (const Kind bad : {kStraight, kNoOverlap, kRepeated}) {
    if (chosen[kHandheld] && chosen[bad]) {
      kind.Fail(fmt::format("'{}' goes with 'loop' only", kNames[bad]));
    }
  }
  if (chosen[kNoTurning] && !chosen[kHandheld]) kind.Fail("'no-turning' goes with 'handheld' only");
  if (chosen[kRepeated] && (chosen[kStraight] || chosen[kRotation])) {
    kind.Fail("'repeated' goes with neither 'straight' nor 'rotation'");
  }
  if (chosen[kRotation] && (chosen[kNoTurning] || chosen[kStraight])) {
    kind.Fail("'rotation' goes with neither 'straight' nor 'no-turning'");
  }
  return chosen;
}

// The numbers that go with paths that are made, not given.
void ReadMotion(const YamlNode& node, TrajectorySpec* spec) {
  ReadNumber(node, "length", 1, 1e5, &spec->length);
  ReadNumber(node, "speed", 0.01, 100, &spec->speed);
  ReadNumber(node, "rate", 0.1, 10000, &spec->rate);
  ReadNumber(node, "overlap", 0, 1, &spec->overlap);
  ReadNumber(node, "shake", 0, 10, &spec->shake);
  ReadNumber(node, "turn", 0, std::numbers::pi, &spec->turn);
  ReadNumber(node, "roll", 0, std::numbers::pi, &spec->roll);
  if (!node.Has("winding")) return;
  const YamlNode winding = node.At("winding");
  winding.CheckKeys({"amplitude", "seconds"});
  if (winding.Has("amplitude")) {
    spec->amplitude = 0;
    ReadNumber(winding, "amplitude", 0, 100, &*spec->amplitude);
  }
  ReadNumber(winding, "seconds", 0.1, 1e4, &spec->seconds);
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
  if (node.Has("file")) {
    node.CheckKeys({"file", "segment", "frames", "whole"});
    spec->shape = TrajectorySpec::Shape::kGiven;
    spec->given = ReadTrajectory(PathBeside(path, node.At("file")), {});
  } else {
    node.CheckKeys({"kind",
                    "length",
                    "speed",
                    "rate",
                    "segment",
                    "overlap",
                    "winding",
                    "shake",
                    "turn",
                    "roll",
                    "frames",
                    "whole"});
    ReadMotion(node, spec);
  }
  ReadNumber(node, "segment", 0.01, 1e5, &spec->segment);
  if (node.Has("frames") || spec->shape == TrajectorySpec::Shape::kHandheld) {
    spec->frames = node.At("frames").AsInteger();
    ReadInteger(node, "frames", 2, 1000000, &*spec->frames);
  }
  if (node.Has("whole")) spec->whole = node.At("whole").AsBool();
  if (spec->shape == TrajectorySpec::Shape::kLoop) CheckLoop(node, *spec);
}

void ReadSceneSpec(const YamlNode& node, SceneSpec* scene) {
  node.CheckKeys({"points",
                  "near",
                  "far",
                  "boxes",
                  "moving",
                  "track_length",
                  "wrong_matches",
                  "merged",
                  "distances",
                  "distance_sigma"});
  ReadInteger(node, "points", 1, 10000000, &scene->points);
  ReadNumber(node, "near", 1e-3, 1e5, &scene->nearest);
  ReadNumber(node, "far", 1e-3, 1e5, &scene->farthest);
  if (!(scene->farthest > scene->nearest)) {
    const YamlNode place = node.Has("far") ? node.At("far") : node;
    place.Fail(fmt::format(
        "'far' ({} m) must be greater than 'near' ({} m)", scene->farthest, scene->nearest));
  }
  if (node.Has("boxes")) {
    scene->boxes = 0;
    ReadInteger(node, "boxes", 0, 100000, &*scene->boxes);
  }
  ReadNumber(node, "moving", 0, 0.9, &scene->moving);
  ReadNumber(node, "track_length", 1, 1e9, &scene->track_length);
  ReadNumber(node, "wrong_matches", 0, 0.9, &scene->wrong_matches);
  ReadNumber(node, "merged", 0, 1, &scene->merged);
  ReadInteger(node, "distances", 0, 1000, &scene->distances);
  ReadNumber(node, "distance_sigma", 1e-9, 10, &scene->distance_sigma);
}

void ReadCalibrationSigma(const YamlNode& node, CalibrationSigma* sigma) {
  node.CheckKeys({"baseline", "rotation", "focal", "parameters"});
  ReadNumber(node, "baseline", 0, 1, &sigma->baseline);
  ReadNumber(node, "rotation", 0, 1, &sigma->rotation);
  ReadNumber(node, "focal", 0, 1000, &sigma->focal);
  if (!node.Has("parameters")) return;
  // Whether cameras and parameters of these names exist, the reader of the cameras checks.
  for (const auto& [camera, entries] : node.At("parameters").Entries()) {
    for (const auto& [name, value] : entries.Entries()) {
      double& number = sigma->parameters[camera][name];
      ReadNumber(entries, name, 0, 1e12, &number);
    }
  }
}

}  // namespace

ScenerySpec ReadScenery(const YamlNode& root, const std::filesystem::path& path) {
  ScenerySpec spec;
  const YamlNode trajectory = root.At("trajectory");
  const Kinds kinds = ReadKinds(trajectory);
  TrajectorySpec& motion = spec.trajectory;
  if (kinds[kHandheld]) motion.shape = TrajectorySpec::Shape::kHandheld;
  motion.straight = kinds[kStraight];
  motion.rotation = kinds[kRotation];
  motion.no_turning = kinds[kNoTurning];
  motion.one_depth = kinds[kOneDepth];
  motion.no_overlap = kinds[kNoOverlap];
  motion.repeated = kinds[kRepeated];
  if (kinds[kFar]) {
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
