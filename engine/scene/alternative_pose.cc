// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/alternative_pose.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "calib/base/statistics.h"

namespace plenocal {
namespace {

// Votes of a frame's observations of landmarks with a position: those that agree less the others.
void Vote(const SceneState& state, size_t frame, double limit, std::map<int, int>* votes) {
  for (const BundleObservation& seen : state.bundle->observations) {
    if (seen.frame != static_cast<int>(frame)) continue;
    if (!state.has_point[static_cast<size_t>(seen.marker)]) continue;
    (*votes)[seen.marker] += ResidualLength(*state.bundle, seen) <= limit ? 1 : -1;
  }
}

size_t Agreeing(const std::map<int, int>& votes) {
  return static_cast<size_t>(
      std::ranges::count_if(votes, [](const auto& vote) { return vote.second > 0; }));
}

// Number of landmarks with a position that would agree with another pose of the frame by chance:
// those whose residuals have their lengths and any direction.
double ExpectedByChance(const SceneState& state, size_t frame, double limit) {
  std::map<int, double> longest;
  for (const BundleObservation& seen : state.bundle->observations) {
    if (seen.frame != static_cast<int>(frame)) continue;
    if (!state.has_point[static_cast<size_t>(seen.marker)]) continue;
    double& length = longest[seen.marker];
    length = std::max(length, ResidualLength(*state.bundle, seen));
  }
  double sum = 0;
  for (const auto& [marker, length] : longest) {
    sum += std::asin(std::min(1.0, limit / length)) / std::numbers::pi;
  }
  return sum;
}

// True if the best of all poses that are tried for so many frames has as many landmarks by
// chance.
bool IsChance(size_t agreeing, double expected, size_t frames) {
  constexpr double kByMaking = 3;  // landmarks that determine a pose
  // 1000 samples of three points, up to four poses each.
  const double poses_tried = 4e3 * static_cast<double>(frames);
  const double count = static_cast<double>(agreeing) - kByMaking;
  if (count <= expected) return true;
  // Chernoff's bound of the Poisson distribution's tail.
  const double log_tail = count - expected - count * std::log(count / expected);
  return log_tail > std::log(kFalseAlarm / poses_tried);
}

}  // namespace

std::string AlternativePose::Text() const {
  return fmt::format(
      "{} of {} common points contradict this pose and agree on another one, {:.3g} m and {:.2g} "
      "degrees away",
      contradicting,
      agreeing + contradicting,
      distance,
      angle * 180 / std::numbers::pi);
}

std::optional<AlternativePose> FindAlternativePose(const SceneState& state,
                                                   const std::vector<size_t>& frames,
                                                   double limit) {
  std::map<int, int> votes;
  for (const size_t frame : frames) Vote(state, frame, limit, &votes);
  SceneState others = state;
  for (const auto& [marker, sum] : votes) {
    if (sum > 0) others.has_point[static_cast<size_t>(marker)] = false;
  }
  AlternativePose alternative{.agreeing = Agreeing(votes)};
  votes.clear();
  size_t most = 0;
  for (const size_t frame : frames) {
    constexpr size_t kMoreThanMade = 4;  // whether so many agree by chance is judged here
    const std::optional<PoseSearch> found = FindPose(others, frame, limit, kMoreThanMade);
    if (!found || IsChance(found->inliers, ExpectedByChance(others, frame, limit), frames.size())) {
      continue;
    }
    RigidTransform& T_rig_target = state.bundle->T_rig_target[frame];
    const RigidTransform before = std::exchange(T_rig_target, found->T_rig_target);
    Vote(others, frame, limit, &votes);
    T_rig_target = before;
    if (found->inliers <= most) continue;
    most = found->inliers;
    const RigidTransform change = before.Inverse() * found->T_rig_target;
    alternative.distance = (before.Inverse().t - found->T_rig_target.Inverse().t).norm();
    alternative.angle = Eigen::AngleAxisd(change.R).angle();
  }
  if (most == 0) return std::nullopt;
  alternative.contradicting = Agreeing(votes);
  return alternative;
}

}  // namespace plenocal
