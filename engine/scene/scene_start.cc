// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/scene_start.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <opencv2/calib3d.hpp>
#include <random>
#include <set>
#include <utility>

#include "calib/adjust/poses.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "calib/camera/rays.h"
#include "calib/space/point_fit.h"

namespace plenocal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Residuals within this many robust sigmas are inliers: one Gaussian one in 200 is longer.
constexpr double kInlierSigmas = 3.3;
struct Range {
  size_t begin = 0, end = 0;
};

Range ObservationsOf(const Bundle& bundle, size_t frame) {
  const auto less = [](const BundleObservation& o, int f) { return o.frame < f; };
  const auto& all = bundle.observations;
  const auto begin = std::lower_bound(all.begin(), all.end(), static_cast<int>(frame), less);
  const auto end = std::lower_bound(begin, all.end(), static_cast<int>(frame) + 1, less);
  return {static_cast<size_t>(begin - all.begin()), static_cast<size_t>(end - all.begin())};
}

// Ray of an observation in the frame of its rig.
std::optional<Ray> RigRay(const Bundle& bundle, const BundleObservation& observation) {
  const BundleCamera& camera = bundle.cameras[static_cast<size_t>(observation.camera)];
  const std::optional<Ray> ray = Unproject(camera, observation.seen.values.data());
  if (!ray) return std::nullopt;
  const RigidTransform T_rig_camera = camera.T_camera_rig.Inverse();
  return Ray{T_rig_camera * ray->origin, T_rig_camera.R * ray->direction};
}

// The point nearest to rays, before all of them.
std::optional<NearestPoint> Before(const std::vector<Ray>& rays) {
  const std::optional<NearestPoint> point = NearestToRays(rays);
  if (!point) return std::nullopt;
  for (const Ray& ray : rays) {
    if (ray.direction.dot(point->position - ray.origin) <= 0) return std::nullopt;
  }
  return point;
}

// Landmarks with positions that one camera of a frame shows, as directions for P3P.
struct SeenDirections {
  std::vector<size_t> observations;
  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> directions;  // x / z, y / z in the camera's frame
};

// Directions beyond this angle to the axis stretch x / z.
constexpr double kWidestSine = 0.97;

// Direction of a landmark in a camera's frame, from its observations in one view. The rays of a
// plenoptic camera have no common origin: they meet near the landmark, more or less far along the
// ray through the lens' middle.
std::optional<Eigen::Vector3d> DirectionOf(const Bundle& bundle, Range observations) {
  std::vector<Ray> rays;
  for (size_t i = observations.begin; i < observations.end; ++i) {
    const BundleObservation& seen = bundle.observations[i];
    const BundleCamera& camera = bundle.cameras[static_cast<size_t>(seen.camera)];
    const std::optional<Ray> ray = Unproject(camera, seen.seen.values.data());
    if (ray) rays.push_back(*ray);
  }
  if (rays.empty()) return std::nullopt;
  if (rays.size() == 1) return rays[0].direction;
  const std::optional<NearestPoint> point = Before(rays);
  return point ? std::optional(point->position.normalized()) : std::nullopt;
}

SeenDirections DirectionsSeen(const SceneState& state, size_t frame, int camera) {
  const Bundle& bundle = *state.bundle;
  const Range range = ObservationsOf(bundle, frame);
  SeenDirections seen_points;
  for (size_t i = range.begin, end = i; i < range.end; i = end) {
    end = EndOfMarker(bundle.observations, i);
    const BundleObservation& observation = bundle.observations[i];
    const auto m = static_cast<size_t>(observation.marker);
    if (observation.camera != camera || !state.has_point[m]) continue;
    const std::optional<Eigen::Vector3d> direction = DirectionOf(bundle, {i, end});
    if (!direction || direction->z() < std::sqrt(1 - kWidestSine * kWidestSine)) continue;
    const Eigen::Vector3d& p = bundle.markers[m].position;
    seen_points.observations.push_back(i);
    seen_points.points.emplace_back(p.x(), p.y(), p.z());
    seen_points.directions.emplace_back(direction->x() / direction->z(),
                                        direction->y() / direction->z());
  }
  return seen_points;
}

RigidTransform PoseOf(const cv::Mat& rotation, const cv::Mat& translation) {
  const Eigen::Vector3d w(rotation.at<double>(0), rotation.at<double>(1), rotation.at<double>(2));
  return {ExpRotation(w),
          {translation.at<double>(0), translation.at<double>(1), translation.at<double>(2)}};
}

// Least-median search for the pose of one frame.
class PoseFinder {
 public:
  PoseFinder(const SceneState& state, size_t frame, std::optional<double> limit)
      : state_(state),
        bundle_(*state.bundle),
        frame_(frame),
        limit_(limit),
        random_(static_cast<unsigned>(frame)) {
    const Range range = ObservationsOf(bundle_, frame);
    for (size_t i = range.begin; i < range.end; ++i) {
      const auto m = static_cast<size_t>(bundle_.observations[i].marker);
      if (state.has_point[m]) known_.push_back(i);
    }
    std::sample(known_.begin(), known_.end(), std::back_inserter(sample_), kSampleSize, random_);
  }

  std::optional<PoseSearch> Run() {
    std::optional<PoseSearch> best;
    double best_cost = kInfinity;
    const int samples = limit_ ? kSamplesAmongMany : kSamples;
    const RigidTransform before = bundle_.T_rig_target[frame_];
    const auto [camera, seen_points] = BestView();
    const RigidTransform T_rig_camera = bundle_.cameras[camera].T_camera_rig.Inverse();
    for (int sample = 0; sample < samples && !seen_points.points.empty(); ++sample) {
      for (const RigidTransform& T_camera_target : Hypotheses(seen_points)) {
        const RigidTransform T = T_rig_camera * T_camera_target;
        const double cost = Cost(T);
        if (cost >= best_cost) continue;
        best_cost = cost;
        best = PoseSearch{.T_rig_target = T};
      }
    }
    if (best) Refine(&*best);
    bundle_.T_rig_target[frame_] = before;
    if (best && !limit_ && best->inliers < (best->candidates + 1) / 2) return std::nullopt;
    return best;
  }

 private:
  // Half of the landmarks wrong: one sample of four in 16 is good; none in 150 are 6e-5.
  static constexpr int kSamples = 150;
  // A fifth of them good: one sample of three in 125; none in 1000 are 3e-4.
  static constexpr int kSamplesAmongMany = 1000;
  // The median of so many residuals is known to a tenth.
  static constexpr size_t kSampleSize = 200;

  // The camera that shows most landmarks, if they suffice; a camera without a common origin of its
  // rays only where no other does.
  std::pair<size_t, SeenDirections> BestView() const {
    std::pair<size_t, SeenDirections> best;
    for (const bool central : {true, false}) {
      for (size_t c = 0; c < bundle_.cameras.size(); ++c) {
        if (bundle_.cameras[c].model->IsCentral() != central) continue;
        SeenDirections seen_points = DirectionsSeen(state_, frame_, static_cast<int>(c));
        if (seen_points.points.size() < std::max(kFewestLandmarks, best.second.points.size() + 1)) {
          continue;
        }
        best = {c, std::move(seen_points)};
      }
      if (!best.second.points.empty()) break;
    }
    return best;
  }

  std::vector<RigidTransform> Hypotheses(const SeenDirections& seen_points) {
    std::vector<cv::Point3d> points;
    std::vector<cv::Point2d> directions;
    std::array<size_t, 3> chosen{};
    std::uniform_int_distribution<size_t> any(0, seen_points.points.size() - 1);
    for (size_t i = 0; i < chosen.size(); ++i) {
      do {
        chosen[i] = any(random_);
      } while (std::find(chosen.begin(),
                         chosen.begin() + static_cast<std::ptrdiff_t>(i),
                         chosen[i]) != chosen.begin() + static_cast<std::ptrdiff_t>(i));
      points.push_back(seen_points.points[chosen[i]]);
      directions.push_back(seen_points.directions[chosen[i]]);
    }
    std::vector<cv::Mat> rotations, translations;
    cv::solveP3P(points,
                 directions,
                 cv::Mat::eye(3, 3, CV_64F),
                 cv::noArray(),
                 rotations,
                 translations,
                 cv::SOLVEPNP_AP3P);
    std::vector<RigidTransform> poses;
    for (size_t i = 0; i < rotations.size(); ++i) {
      const RigidTransform T = PoseOf(rotations[i], translations[i]);
      if (T.t.allFinite() && T.R.allFinite()) poses.push_back(T);
    }
    return poses;
  }

  // Median of the residuals, or less the number of those below the limit.
  double Cost(const RigidTransform& T) {
    bundle_.T_rig_target[frame_] = T;
    residuals_.clear();
    for (const size_t i : sample_) {
      residuals_.push_back(ResidualLength(bundle_, bundle_.observations[i]));
    }
    if (limit_) {
      const auto agrees = [&](double length) { return length <= *limit_; };
      return -static_cast<double>(std::ranges::count_if(residuals_, agrees));
    }
    const auto middle = residuals_.begin() + static_cast<std::ptrdiff_t>(residuals_.size() / 2);
    std::nth_element(residuals_.begin(), middle, residuals_.end());
    return *middle;
  }

  // Robust sigma of a coordinate with this pose.
  double SigmaOf(const RigidTransform& T) {
    if (limit_) return *limit_ / kInlierSigmas;
    return Cost(T) / std::sqrt(ChiSquareQuantile(2, 0.5));
  }

  // Inliers of the best hypothesis refine it and decide again.
  void Refine(PoseSearch* search) {
    const Range range = ObservationsOf(bundle_, frame_);
    search->sigma = SigmaOf(search->T_rig_target);
    bundle_.T_rig_target[frame_] = search->T_rig_target;
    for (size_t i = range.begin; i < range.end; ++i) bundle_.observations[i].used = false;
    for (const size_t i : known_) {
      BundleObservation& observation = bundle_.observations[i];
      observation.used = ResidualLength(bundle_, observation) <= kInlierSigmas * search->sigma;
    }
    AdjustPose(range.begin, range.end, &bundle_);
    search->T_rig_target = bundle_.T_rig_target[frame_];
    search->sigma = SigmaOf(search->T_rig_target);
    bundle_.T_rig_target[frame_] = search->T_rig_target;
    CountInliers(search);
  }

  void CountInliers(PoseSearch* search) {
    std::map<int, bool> agrees;
    for (const size_t i : known_) {
      const BundleObservation& observation = bundle_.observations[i];
      const bool inlier = ResidualLength(bundle_, observation) <= kInlierSigmas * search->sigma;
      const auto [entry, first] = agrees.emplace(observation.marker, inlier);
      entry->second = entry->second && inlier;
    }
    search->candidates = agrees.size();
    for (const auto& [marker, inlier] : agrees) search->inliers += inlier ? 1 : 0;
  }

  const SceneState& state_;
  Bundle& bundle_;
  size_t frame_;
  std::optional<double> limit_;
  std::vector<size_t> known_;   // observations of landmarks with positions
  std::vector<size_t> sample_;  // some of them
  std::vector<double> residuals_;
  std::mt19937 random_;
};

// Least root mean square of the sines between the rays of a new point and their mean. One view of a
// plenoptic camera needs no pose: there the noise of its own rays is the limit.
double LeastSpread(const std::vector<size_t>& observations, const SceneState& state) {
  constexpr double kDepthSigmas = 10;  // distance over its standard error
  const Bundle& bundle = *state.bundle;
  const BundleObservation& first = bundle.observations[observations[0]];
  const double least = state.least_parallax / 2;
  for (const size_t i : observations) {
    const BundleObservation& seen = bundle.observations[i];
    if (seen.frame != first.frame || seen.camera != first.camera) return least;
  }
  BundleObservation beside = first;
  beside.seen.values[0] += 1;
  const std::optional<Ray> a = RigRay(bundle, first), b = RigRay(bundle, beside);
  if (!a || !b) return least;
  const double radians_per_px = a->direction.normalized().cross(b->direction.normalized()).norm();
  return std::min(least, kDepthSigmas * radians_per_px * first.assumed_sigma);
}

// Gives a landmark the point of these observations if they agree with it.
bool AcceptPoint(const std::vector<size_t>& observations,
                 double largest_residual,
                 SceneState* state) {
  Bundle& bundle = *state->bundle;
  std::vector<Ray> rays;
  for (const size_t i : observations) {
    const BundleObservation& observation = bundle.observations[i];
    const std::optional<Ray> ray = RigRay(bundle, observation);
    if (!ray) return false;
    const RigidTransform T = bundle.T_rig_target[static_cast<size_t>(observation.frame)].Inverse();
    rays.push_back({T * ray->origin, T.R * ray->direction});
  }
  const std::optional<NearestPoint> point = Before(rays);
  if (!point || point->spread < std::pow(LeastSpread(observations, *state), 2)) return false;
  const auto m = static_cast<size_t>(bundle.observations[observations[0]].marker);
  const Eigen::Vector3d before = bundle.markers[m].position;
  bundle.markers[m].position = point->position;
  for (const size_t i : observations) {
    if (ResidualLength(bundle, bundle.observations[i]) <= largest_residual) continue;
    bundle.markers[m].position = before;
    return false;
  }
  state->has_point[m] = true;
  return true;
}

// A landmark's observations in the first frame with a pose.
std::vector<size_t> ObservationsInFirstFrame(const SceneState& state, int marker) {
  const auto& observations = state.bundle->observations;
  std::vector<size_t> first;
  for (const size_t i : state.observations_of[static_cast<size_t>(marker)]) {
    const int frame = observations[i].frame;
    if (!state.has_pose[static_cast<size_t>(frame)]) continue;
    if (!first.empty() && observations[first[0]].frame != frame) break;
    first.push_back(i);
  }
  return first;
}

// Markers that each frame shows.
std::vector<std::set<int>> MarkersByFrame(const Bundle& bundle) {
  std::vector<std::set<int>> markers(bundle.T_rig_target.size());
  for (const BundleObservation& observation : bundle.observations) {
    markers[static_cast<size_t>(observation.frame)].insert(observation.marker);
  }
  return markers;
}

// Three robust sigmas of one coordinate from lengths of residuals that are one coordinate's.
double LimitOf(std::vector<double> lengths) {
  if (lengths.empty()) return 0;
  return kInlierSigmas / std::sqrt(ChiSquareQuantile(1, 0.5)) * Median(std::move(lengths));
}

// Residual below which the rays of a frame's cameras agree: a robust sigma of its own points.
double OwnResidualLimit(size_t frame, SceneState* state) {
  const Bundle& bundle = *state->bundle;
  const SceneState before = *state;
  Triangulate(frame, kInfinity, state);
  std::vector<double> lengths;
  const Range range = ObservationsOf(bundle, frame);
  for (size_t i = range.begin; i < range.end; ++i) {
    if (!state->has_point[static_cast<size_t>(bundle.observations[i].marker)]) continue;
    lengths.push_back(ResidualLength(bundle, bundle.observations[i]));
  }
  state->has_point = before.has_point;
  return LimitOf(std::move(lengths));
}

}  // namespace

double ResidualLength(const Bundle& bundle, const BundleObservation& observation) {
  const BundleCamera& camera = bundle.cameras[static_cast<size_t>(observation.camera)];
  const RigidTransform& T = bundle.T_rig_target[static_cast<size_t>(observation.frame)];
  const Eigen::Vector3d p =
      camera.T_camera_rig * (T * bundle.markers[static_cast<size_t>(observation.marker)].position);
  double predicted[kMaxObservationSize];
  const double* const values = observation.seen.values.data();
  if (!Project(camera, values, p, predicted)) {
    return kInfinity;
  }
  double square = 0;
  for (size_t r = 0; r < camera.model->measured.size(); ++r) {
    square += (values[r] - predicted[r]) * (values[r] - predicted[r]);
  }
  return std::sqrt(square);
}

double ResidualLimit(const SceneState& state) {
  std::vector<double> lengths;
  for (const BundleObservation& seen : state.bundle->observations) {
    if (!seen.used || !state.has_pose[static_cast<size_t>(seen.frame)] ||
        !state.has_point[static_cast<size_t>(seen.marker)]) {
      continue;
    }
    lengths.push_back(ResidualLength(*state.bundle, seen));
  }
  return LimitOf(std::move(lengths));
}

std::optional<double> ScaleByOwnDistances(const SceneState& state) {
  const Bundle& bundle = *state.bundle;
  std::vector<double> ratios;
  for (size_t i = 0, end = 0; i < bundle.observations.size(); i = end) {
    const BundleObservation& first = bundle.observations[i];
    std::vector<Ray> rays;
    for (end = i; end < bundle.observations.size(); ++end) {
      const BundleObservation& seen = bundle.observations[end];
      if (seen.frame != first.frame || seen.camera != first.camera || seen.marker != first.marker) {
        break;
      }
      if (const std::optional<Ray> ray = RigRay(bundle, seen)) rays.push_back(*ray);
    }
    const auto frame = static_cast<size_t>(first.frame), marker = static_cast<size_t>(first.marker);
    if (rays.size() < 2 || !state.has_pose[frame] || !state.has_point[marker]) continue;
    const std::optional<NearestPoint> point = Before(rays);
    if (!point) continue;
    const Eigen::Vector3d placed = bundle.T_rig_target[frame] * bundle.markers[marker].position;
    ratios.push_back(point->position.z() / placed.z());
  }
  if (ratios.empty()) return std::nullopt;
  const double scale = Median(std::move(ratios));
  return scale > 0 ? std::optional(scale) : std::nullopt;
}

SceneState MakeSceneState(Bundle* bundle) {
  SceneState state{bundle,
                   std::vector<bool>(bundle->T_rig_target.size(), false),
                   std::vector<bool>(bundle->markers.size(), false),
                   std::vector<std::vector<size_t>>(bundle->markers.size())};
  for (size_t i = 0; i < bundle->observations.size(); ++i) {
    state.observations_of[static_cast<size_t>(bundle->observations[i].marker)].push_back(i);
  }
  return state;
}

std::optional<PoseSearch> FindPose(const SceneState& state,
                                   size_t frame,
                                   std::optional<double> limit,
                                   size_t fewest_agreeing) {
  const std::optional<PoseSearch> found = PoseFinder(state, frame, limit).Run();
  return found && limit && found->inliers < fewest_agreeing ? std::nullopt : found;
}

void Triangulate(size_t frame, double largest_residual, SceneState* state) {
  const Bundle& bundle = *state->bundle;
  const Range range = ObservationsOf(bundle, frame);
  std::map<int, std::vector<size_t>> of_marker;
  for (size_t i = range.begin; i < range.end; ++i) {
    const int marker = bundle.observations[i].marker;
    if (!state->has_point[static_cast<size_t>(marker)]) of_marker[marker].push_back(i);
  }
  for (const auto& [marker, observations] : of_marker) {
    if (AcceptPoint(observations, largest_residual, state)) continue;
    std::vector<size_t> with_first = ObservationsInFirstFrame(*state, marker);
    if (with_first.empty() || bundle.observations[with_first[0]].frame == static_cast<int>(frame)) {
      continue;
    }
    with_first.insert(with_first.end(), observations.begin(), observations.end());
    AcceptPoint(with_first, largest_residual, state);
  }
}

size_t FollowByOverlap(const std::function<void(size_t)>& posed, SceneState* state) {
  const std::vector<std::set<int>> markers = MarkersByFrame(*state->bundle);
  std::vector<bool> failed(markers.size(), false);
  size_t count = static_cast<size_t>(std::ranges::count(state->has_pose, true));
  while (true) {
    size_t best = markers.size(), most = kFewestLandmarks - 1;
    for (size_t frame = 0; frame < markers.size(); ++frame) {
      if (state->has_pose[frame] || failed[frame]) continue;
      const auto known = static_cast<size_t>(std::ranges::count_if(
          markers[frame], [&](int m) { return state->has_point[static_cast<size_t>(m)]; }));
      if (known <= most) continue;
      most = known;
      best = frame;
    }
    if (best == markers.size()) return count;
    FollowFrames({best}, state);
    failed[best] = !state->has_pose[best];
    if (failed[best]) continue;
    // New points may place a frame that the others did not.
    failed.assign(failed.size(), false);
    posed(++count);
  }
}

void KeepStarted(const SceneState& state, Bundle* bundle) {
  std::erase_if(bundle->observations, [&](const BundleObservation& observation) {
    return !state.has_pose[static_cast<size_t>(observation.frame)] ||
           !state.has_point[static_cast<size_t>(observation.marker)];
  });
}

double FollowFrames(const std::vector<size_t>& frames, SceneState* state) {
  double limit = 0;
  for (const size_t frame : frames) {
    Bundle& bundle = *state->bundle;
    if (!state->has_pose[frame]) {
      const bool first =
          std::find(state->has_pose.begin(), state->has_pose.end(), true) == state->has_pose.end();
      const std::optional<PoseSearch> found =
          first ? PoseSearch{.T_rig_target = {}} : FindPose(*state, frame);
      if (!found) continue;
      bundle.T_rig_target[frame] = found->T_rig_target;
      state->has_pose[frame] = true;
      limit = kInlierSigmas * found->sigma;
    }
    if (limit == 0) limit = OwnResidualLimit(frame, state);
    Triangulate(frame, limit, state);
  }
  return limit;
}

}  // namespace plenocal
