// SPDX-License-Identifier: Apache-2.0
#include "apps/scene/rival_pose.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

#include "calib/rig_test.h"

namespace plenocal {
namespace {

// Landmarks with a position that `frames` show; true: most of their observations agree.
std::map<int, bool> Agreement(const SceneState& state, const std::set<int>& frames, double limit) {
  std::map<int, int> votes;
  for (const BundleObservation& seen : state.bundle->observations) {
    if (!frames.contains(seen.frame) || !state.has_point[static_cast<size_t>(seen.marker)])
      continue;
    votes[seen.marker] += ResidualLength(*state.bundle, seen) <= limit ? 1 : -1;
  }
  std::map<int, bool> agrees;
  for (const auto& [marker, sum] : votes) agrees[marker] = sum > 0;
  return agrees;
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

// Whether the best of all poses that are tried would have so few landmarks by chance.
bool IsChance(size_t agreeing, double expected) {
  constexpr double kByMaking = 3;      // landmarks that determine a pose
  constexpr double kPosesTried = 4e3;  // 1000 samples of three points, up to four poses each
  const double count = static_cast<double>(agreeing) - kByMaking;
  if (count <= expected) return true;
  // Chernoff's bound of the Poisson distribution's tail.
  const double log_tail = count - expected - count * std::log(count / expected);
  return log_tail > std::log(kFalseAlarm / kPosesTried);
}

}  // namespace

std::string RivalPose::Text() const {
  return fmt::format(
      "{} of {} common points contradict this pose and agree on another one, {:.3g} m and {:.2g} "
      "degrees away",
      rivals,
      agreeing + rivals,
      distance,
      angle * 180 / std::numbers::pi);
}

std::optional<RivalPose> FindRivalPose(const SceneState& state,
                                       const std::vector<size_t>& frames,
                                       double limit) {
  const std::set<int> of_pose(frames.begin(), frames.end());
  const std::map<int, bool> agrees = Agreement(state, of_pose, limit);
  Bundle& bundle = *state.bundle;
  SceneState others = state;
  RivalPose rival;
  for (const auto& [marker, good] : agrees) {
    if (!good) continue;
    others.has_point[static_cast<size_t>(marker)] = false;
    ++rival.agreeing;
  }
  std::map<int, size_t> contradicting;  // by frame
  for (const BundleObservation& seen : bundle.observations) {
    if (!of_pose.contains(seen.frame)) continue;
    contradicting[seen.frame] += others.has_point[static_cast<size_t>(seen.marker)] ? 1 : 0;
  }
  if (contradicting.empty()) return std::nullopt;
  using Count = std::pair<const int, size_t>;
  const auto frame =
      static_cast<size_t>(std::ranges::max_element(contradicting, {}, &Count::second)->first);
  const std::optional<PoseSearch> found = FindPose(others, frame, limit);
  if (!found || IsChance(found->inliers, ExpectedByChance(others, frame, limit))) {
    return std::nullopt;
  }
  const RigidTransform T_target_rig = bundle.T_rig_target[frame].Inverse();
  const RigidTransform change = T_target_rig * found->T_rig_target;
  const std::vector<RigidTransform> poses = bundle.T_rig_target;
  for (const size_t each : frames) bundle.T_rig_target[each] = poses[each] * change;
  for (const auto& [marker, good] : Agreement(others, of_pose, limit)) rival.rivals += good ? 1 : 0;
  bundle.T_rig_target = poses;
  rival.distance = (T_target_rig.t - found->T_rig_target.Inverse().t).norm();
  rival.angle = Eigen::AngleAxisd(change.R).angle();
  return rival;
}

}  // namespace plenocal
