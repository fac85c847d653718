// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/scene_views.h"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <utility>

#include "calib/adjust/landmarks.h"
#include "calib/adjust/solver/adjust.h"
#include "calib/base/format_error.h"
#include "calib/base/statistics.h"
#include "calib/camera/rays.h"
#include "calib/estimate/reject.h"
#include "calib/noise/camera_noise.h"
#include "engine/scene/scene_start.h"

namespace plenocal {
namespace {

// Start values need no more.
constexpr double kStartTolerance = 1e-4;

// Directions x / z, y / z of one camera's points in one frame, by number of the landmark.
using FrameDirections = std::map<int, cv::Point2d>;

std::vector<FrameDirections> DirectionsOfFrames(const Bundle& bundle) {
  std::vector<FrameDirections> frames(bundle.T_rig_target.size());
  const BundleCamera& camera = bundle.cameras[0];
  for (const BundleObservation& seen : bundle.observations) {
    const std::optional<Ray> ray = Unproject(camera, seen.seen.values.data());
    constexpr double kLeastCosine = 0.2;  // x / z grows beyond all bounds
    if (!ray || ray->direction.z() < kLeastCosine) continue;
    frames[static_cast<size_t>(seen.frame)][seen.marker] = {
        ray->direction.x() / ray->direction.z(), ray->direction.y() / ray->direction.z()};
  }
  return frames;
}

struct TwoViews {
  size_t a = 0, b = 0;
  RigidTransform T_b_a;
  double parallax = 0;  // sum over the points that agree, rad
};

// From the essential matrix.
std::optional<TwoViews> RelateViews(const std::vector<FrameDirections>& frames,
                                    size_t a,
                                    size_t b) {
  constexpr size_t kFewestCommonPoints = 20;
  // More adds nothing to a point.
  constexpr double kMostParallax = 0.2;
  std::vector<cv::Point2d> in_a, in_b;
  for (const auto& [marker, direction] : frames[a]) {
    const auto other = frames[b].find(marker);
    if (other == frames[b].end()) continue;
    in_a.push_back(direction);
    in_b.push_back(other->second);
  }
  if (in_a.size() < kFewestCommonPoints) return std::nullopt;
  const cv::Mat identity = cv::Mat::eye(3, 3, CV_64F);
  const cv::Mat essential = cv::findEssentialMat(in_a, in_b, identity, cv::LMEDS, 0.999);
  if (essential.rows != 3) return std::nullopt;
  cv::Mat R, t, mask;
  cv::recoverPose(essential, in_a, in_b, identity, R, t, mask);
  TwoViews views{.a = a, .b = b, .T_b_a = {}};
  for (int i = 0; i < 3; ++i) {
    views.T_b_a.t[i] = t.at<double>(i);
    for (int j = 0; j < 3; ++j) views.T_b_a.R(i, j) = R.at<double>(i, j);
  }
  for (size_t i = 0; i < in_a.size(); ++i) {
    if (mask.at<unsigned char>(static_cast<int>(i)) == 0) continue;
    const Eigen::Vector3d from_a =
        views.T_b_a.R * Eigen::Vector3d(in_a[i].x, in_a[i].y, 1).normalized();
    const Eigen::Vector3d from_b = Eigen::Vector3d(in_b[i].x, in_b[i].y, 1).normalized();
    views.parallax += std::min(kMostParallax, from_a.cross(from_b).norm());
  }
  return views;
}

std::vector<size_t> ByNumberOfPoints(const std::vector<FrameDirections>& frames) {
  std::vector<size_t> order(frames.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::ranges::stable_sort(order, std::greater<>(), [&](size_t i) { return frames[i].size(); });
  return order;
}

// The pair of frames with most points and parallax among those tried.
std::optional<TwoViews> BestTwoViews(const Bundle& bundle) {
  constexpr size_t kFirst = 4, kSecond = 25;
  const std::vector<FrameDirections> frames = DirectionsOfFrames(bundle);
  const std::vector<size_t> order = ByNumberOfPoints(frames);
  std::optional<TwoViews> best;
  for (size_t i = 0; i < std::min(kFirst, order.size()); ++i) {
    for (size_t j = i + 1; j < std::min(i + 1 + kSecond, order.size()); ++j) {
      const std::optional<TwoViews> views =
          RelateViews(frames, std::min(order[i], order[j]), std::max(order[i], order[j]));
      if (views && (!best || views->parallax > best->parallax)) best = views;
    }
  }
  return best;
}

class SceneReconstruction {
 public:
  SceneReconstruction(const SceneTracks& tracks,
                      const std::vector<BundleCamera>& cameras,
                      const std::optional<CalibrationPrior>& prior)
      : bundle_(MakeSceneBundle(tracks, cameras)), state_(MakeSceneState(&bundle_)) {
    bundle_.prior = prior;
  }

  ReconstructedScene Run() {
    if (bundle_.cameras.size() == 1) {
      StartWithTwoViews();
    } else {
      StartWithRig();
    }
    const bool adjusts = std::ranges::any_of(bundle_.cameras, [](const BundleCamera& camera) {
      return std::ranges::find(camera.fixed, false) != camera.fixed.end();
    });
    size_t next = 4;
    FollowByOverlap(
        [&](size_t count) {
          if (!adjusts || count < next) return;
          Adjust();
          next = 2 * count;
        },
        &state_);
    Adjust();
    // Better parameters place what did not fit before.
    FollowByOverlap([](size_t) {}, &state_);
    Adjust();
    return Result();
  }

 private:
  void StartWithTwoViews() {
    const std::optional<TwoViews> views = BestTwoViews(bundle_);
    if (!views) {
      throw JobError(
          "{}: no two frames with 20 points in common between which the camera moved; "
          "record frames that overlap more, or give a calibrated pair ('from')",
          bundle_.cameras[0].name);
    }
    bundle_.T_rig_target[views->b] = views->T_b_a;
    state_.has_pose[views->a] = state_.has_pose[views->b] = true;
    FollowFrames({views->b}, &state_);
  }

  void StartWithRig() {
    std::vector<size_t> counts(bundle_.T_rig_target.size(), 0);
    for (const BundleObservation& seen : bundle_.observations) {
      ++counts[static_cast<size_t>(seen.frame)];
    }
    const auto most = std::ranges::max_element(counts);
    if (most == counts.end()) return;
    FollowFrames({static_cast<size_t>(most - counts.begin())}, &state_);
  }

  void Adjust() { AdjustStarted(bundle_.cameras.size() == 1, &state_); }

  ReconstructedScene Result() {
    ReconstructedScene scene{.cameras = bundle_.cameras, .T_rig_target = {}, .points = {}};
    for (size_t frame = 0; frame < state_.has_pose.size(); ++frame) {
      scene.T_rig_target.emplace_back();
      if (!state_.has_pose[frame]) continue;
      scene.T_rig_target.back() = bundle_.T_rig_target[frame];
      ++scene.frames;
    }
    for (size_t m = 0; m < state_.has_point.size(); ++m) {
      if (state_.has_point[m])
        scene.points[bundle_.markers[m].number] = bundle_.markers[m].position;
    }
    KeepStarted(state_, &bundle_);
    for (BundleCamera& camera : bundle_.cameras) camera.noise = {};
    for (BundleObservation& seen : bundle_.observations) seen.assumed_sigma = 1;
    scene.median_residual = Median(WeightedLengths(bundle_));
    return scene;
  }

  Bundle bundle_;
  SceneState state_;
};

}  // namespace

ReconstructedScene ReconstructScene(const SceneTracks& tracks,
                                    const std::vector<BundleCamera>& cameras,
                                    const std::optional<CalibrationPrior>& prior) {
  return SceneReconstruction(tracks, cameras, prior).Run();
}

void AdjustStarted(bool hold_scale, SceneState* state) {
  Bundle& bundle = *state->bundle;
  Bundle started = bundle;
  KeepStarted(*state, &started);
  const auto first = std::ranges::find(state->has_pose, true);
  if (first == state->has_pose.end() || started.observations.empty()) return;
  started.fixed_frame = static_cast<size_t>(first - state->has_pose.begin());
  EstimateNoiseRobustly(state->has_pose, TypicalSigmas(started), &started);
  UseProjecting(state->has_pose, &started);
  RejectLandmarks(&started);
  if (hold_scale) HoldScale(&started);
  AdjustOptions options;
  options.loss = Loss::kHuber;
  options.cost_tolerance = kStartTolerance;
  if (!Adjust(&started, options).usable) return;
  bundle.cameras = started.cameras;
  bundle.T_rig_target = started.T_rig_target;
  bundle.markers = started.markers;
}

void HoldScale(Bundle* bundle) {
  constexpr double kTight = 1e-6;
  std::vector<size_t> seen(bundle->markers.size(), 0);
  for (const BundleObservation& observation : bundle->observations) {
    if (observation.used) ++seen[static_cast<size_t>(observation.marker)];
  }
  if (seen.empty()) return;
  const auto a = static_cast<size_t>(std::ranges::max_element(seen) - seen.begin());
  size_t b = a;
  double best = 0;
  for (size_t m = 0; m < seen.size(); ++m) {
    const double apart = (bundle->markers[m].position - bundle->markers[a].position).norm();
    // Points far apart, but well observed ones: the number of their observations limits both.
    const double worth =
        static_cast<double>(seen[m]) * std::min(apart, bundle->markers[a].position.norm());
    if (2 * seen[m] < seen[a] || worth <= best) continue;
    best = worth;
    b = m;
  }
  if (b == a) return;
  const double length = (bundle->markers[b].position - bundle->markers[a].position).norm();
  bundle->scale_distance = {.markers_a = {static_cast<int>(a)},
                            .markers_b = {static_cast<int>(b)},
                            .length = length,
                            .sigma = kTight * length};
}

}  // namespace plenocal
