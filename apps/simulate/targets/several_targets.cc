// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/targets/several_targets.h"

#include <fmt/format.h>

#include "calib/base/quoted_text.h"
#include "calib/camera/marker_id.h"

namespace plenocal::simulate {
namespace {

// Each target has errors of its own.
int TargetSeed(const SimulationSpec& spec, size_t index) {
  constexpr int kStep = 7919;
  return spec.seed + kStep * static_cast<int>(index);
}

}  // namespace

std::vector<TargetInRoom> MakeTargets(const SimulationSpec& spec) {
  const TagErrors tag_errors = spec.rigid_tags ? TagErrors::kRigid : TagErrors::kCorners;
  std::vector<TargetInRoom> targets;
  for (const TargetSpec& each : spec.targets) {
    const Target stated = ReadTarget(each.file);
    const double error = spec.target_error.value_or(stated.tolerance.value_or(0));
    targets.push_back({each.name,
                       stated,
                       MakeTarget(stated, error, tag_errors, TargetSeed(spec, targets.size())),
                       each.T_target_own});
  }
  return targets;
}

TrueTarget InFrameOfFirst(const TargetInRoom& target, size_t index) {
  if (target.IsOnlyOne()) return target.made;
  TrueTarget moved;
  for (const auto& [number, position] : target.made.markers) {
    const int together = MarkerId{index, number}.Number();
    moved.markers[together] = target.T_target_own * position;
    moved.normals[together] = target.T_target_own.R * target.made.normals.at(number);
  }
  return moved;
}

TrueTarget Together(const std::vector<TargetInRoom>& targets) {
  TrueTarget together = InFrameOfFirst(targets[0], 0);
  for (size_t k = 1; k < targets.size(); ++k) {
    const TrueTarget more = InFrameOfFirst(targets[k], k);
    together.markers.insert(more.markers.begin(), more.markers.end());
    together.normals.insert(more.normals.begin(), more.normals.end());
  }
  return together;
}

Target StatedTogether(const std::vector<TargetInRoom>& targets) {
  if (targets[0].IsOnlyOne()) return targets[0].target;
  std::string markers;
  for (size_t k = 0; k < targets.size(); ++k) {
    for (const auto& [number, position] : targets[k].target.markers) {
      const Eigen::Vector3d p = targets[k].T_target_own * position;
      markers += fmt::format(
          "  {}: [{:.12g}, {:.12g}, {:.12g}]\n", MarkerId{k, number}.Number(), p.x(), p.y(), p.z());
    }
  }
  return ReadTarget(YamlNode::Parse("plenocal: 1\ntype: markers\nmarkers:\n" + markers, "targets"));
}

TargetSurface JoinSurfaces(const std::vector<TargetInRoom>& targets, int seed) {
  TargetSurface all(NominalTarget(targets[0].target), targets[0].made, seed);
  for (size_t k = 1; k < targets.size(); ++k) {
    all.Append(TargetSurface(NominalTarget(targets[k].target), targets[k].made, seed),
               targets[k].T_target_own);
  }
  return all;
}

std::string TargetsOfSession(const std::vector<TargetInRoom>& targets) {
  if (targets[0].IsOnlyOne()) return fmt::format("target: {}\n", TargetFile(targets[0]));
  std::string text = "targets:\n";
  for (const TargetInRoom& target : targets) {
    text += fmt::format("  {}: {}\n", YamlText(target.name), TargetFile(target));
  }
  return text;
}

std::string TargetFile(const TargetInRoom& target) {
  return target.IsOnlyOne() ? "target.yaml" : fmt::format("target_{}.yaml", target.name);
}

}  // namespace plenocal::simulate
