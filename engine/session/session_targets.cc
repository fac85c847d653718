// SPDX-License-Identifier: Apache-2.0
#include "engine/session/session_targets.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <span>
#include <string>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/camera/marker_id.h"
#include "calib/io/input_file.h"
#include "engine/session/look_alikes.h"

namespace plenocal {
namespace {

std::string MarkerLine(int number, const Eigen::Vector3d& p) {
  return fmt::format("  {}: [{:.12g}, {:.12g}, {:.12g}]\n", number, p.x(), p.y(), p.z());
}

Target TargetOfMarkers(const std::string& lines, const std::optional<double>& tolerance) {
  const std::string head = "plenocal: 1\ntype: markers\n";
  const std::string states = tolerance ? fmt::format("tolerance: {}\n", *tolerance) : "";
  return ReadTarget(YamlNode::Parse(head + states + "markers:\n" + lines, "targets"));
}

std::optional<double> LargestTolerance(const std::vector<Target>& targets) {
  double largest = 0;
  for (const Target& target : targets) {
    if (!target.tolerance) return std::nullopt;
    largest = std::max(largest, *target.tolerance);
  }
  return largest;
}

// Distances between markers that the targets have, of targets that stay where they are.
void CheckDistances(const Session& session, std::span<const Target> targets) {
  for (const SceneDistance& distance : session.distances) {
    std::vector<size_t> of;
    for (const ScenePosition* end : {&distance.a, &distance.b}) {
      const MarkerId first = MarkerId::FromNumber(end->points[0]);
      of.push_back(session.targets.empty() ? 0 : first.target);
      const Target& target = targets[of.back()];
      const TargetDoubts doubts = DoubtsAbout(target);
      if (!doubts.unknown.empty()) {
        distance.place.Fail(fmt::format(
            "'{0}' of the target is unknown; state it, and in 'scale_sigma' how far it may be off",
            doubts.unknown));
      }
      ScenePosition own = *end;
      for (int& number : own.points) {
        if (!session.targets.empty()) number = MarkerId::FromNumber(number).id;
      }
      if (!HasPosition(target, own)) {
        distance.place.Fail(fmt::format("the target has no {}", end->name));
      }
    }
    if (of[0] != of[1] && (session.targets[of[0]].moves || session.targets[of[1]].moves)) {
      distance.place.Fail(
          "one of the targets moves ('pose: free'), so that this is no fixed distance");
    }
  }
}

}  // namespace

bool HasPosition(const Target& target, const ScenePosition& position) {
  const bool is_tag = position.name.find("tag ") != std::string::npos;
  return std::ranges::all_of(position.points,
                             [&](int number) { return target.markers.contains(number); }) &&
         !(is_tag && DoubtsAbout(target).quads.empty());
}

SessionTargets ReadSessionTargets(const Session& session) {
  SessionTargets targets;
  if (session.targets.empty()) {
    targets.all = ReadTarget(session.target);
    CheckDistances(session, {&targets.all, 1});
    return targets;
  }
  std::string lines;
  for (size_t k = 0; k < session.targets.size(); ++k) {
    targets.several.push_back(ReadTarget(session.targets[k].source));
    if (const std::string key = DoubtsAbout(targets.several.back()).unknown; !key.empty()) {
      throw InputError("{}: target {}: '{}' must be known, as there are several targets",
                       session.path.string(),
                       session.targets[k].name,
                       key);
    }
    for (const auto& [number, position] : targets.several.back().markers) {
      if (number >= MarkerId::kPerTarget) {
        throw InputError(
            "{}: target {} has a marker {}; of several targets the numbers must "
            "be below {}",
            session.path.string(),
            session.targets[k].name,
            number,
            MarkerId::kPerTarget);
      }
      lines += MarkerLine(MarkerId{k, number}.Number(), position);
    }
  }
  CheckDistances(session, targets.several);
  targets.identical_boards = CheckDistinct(session, targets.several);
  targets.all = TargetOfMarkers(lines, LargestTolerance(targets.several));
  for (size_t k = 0; k < targets.several.size(); ++k) {
    for (TargetScale scale : targets.several[k].scales) {
      scale.target = static_cast<int>(k);
      targets.all.scales.push_back(scale);
    }
  }
  return targets;
}

void RefuseSeveralTargets(const Session& session, const char* command) {
  if (session.targets.empty()) return;
  throw InputError(
      "{}: '{}' takes sessions with one target; name it as 'target' in a session "
      "of its own",
      session.path.string(),
      command);
}

std::vector<InputTarget> InputTargetsOf(const Session& session) {
  std::vector<InputTarget> targets;
  for (const SessionTarget& target : session.targets) {
    targets.push_back({.name = target.name, .moves = target.moves, .known = target.known});
  }
  return targets;
}

std::vector<View> JoinViews(std::vector<std::vector<View>> by_target) {
  std::map<std::string, View> joined;
  for (size_t k = 0; k < by_target.size(); ++k) {
    for (View& view : by_target[k]) {
      View& all = joined[view.frame];
      all.frame = view.frame;
      for (Observation& seen : view.observations) {
        seen.marker = MarkerId{k, seen.marker}.Number();
        all.observations.push_back(seen);
      }
      all.by_nuisance.insert(
          all.by_nuisance.end(), view.by_nuisance.begin(), view.by_nuisance.end());
    }
  }
  std::vector<View> views;
  for (auto& [frame, view] : joined) views.push_back(std::move(view));
  return views;
}

Target PlacedTogether(const CalibrationRecord& record) {
  std::string lines;
  for (const auto& [number, marker] : record.markers) {
    lines += MarkerLine(number, marker.nominal.value_or(marker.position));
  }
  return TargetOfMarkers(lines, std::nullopt);
}

std::string RefinedTargetOf(const CalibrationRecord& record, const Target& target, size_t k) {
  const RigidTransform T_own_target = record.targets[k].T_target_own.Inverse();
  MarkerPositions positions, sigmas;
  for (const auto& [number, nominal] : target.markers) {
    const auto found = record.markers.find(MarkerId{k, number}.Number());
    if (found == record.markers.end()) continue;
    positions[number] = T_own_target * found->second.position;
    if (!found->second.sigma) continue;
    // Sigmas along the axes of the target's own frame; correlations between axes are small.
    sigmas[number] = (T_own_target.R.cwiseAbs2() * found->second.sigma->cwiseAbs2()).cwiseSqrt();
  }
  return RefinedTargetYaml(target, positions, sigmas);
}

}  // namespace plenocal
