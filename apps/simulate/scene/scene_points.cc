// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/scene/scene_points.h"

#include <algorithm>
#include <cmath>

#include "apps/simulate/spec/random.h"
#include "calib/base/format_error.h"
#include "calib/base/parallel.h"

namespace plenocal::simulate {
namespace {

// The point that a random line of sight meets, if its depth is within the limits.
struct SightedPoint {
  ScenePoint point;
  double depth = 0;  // m, z in the camera that sees it
};

std::optional<SightedPoint> SightPoint(const SimulationSpec& spec,
                                       const Observer& observer,
                                       const std::vector<const RigInstant*>& used,
                                       const SceneShape& still,
                                       Random* random) {
  const auto sight = DrawSight(spec, observer, used, random);
  if (!sight) return std::nullopt;
  const auto hit = still.Cast(sight->ray.origin, sight->ray.direction);
  if (!hit) return std::nullopt;
  SightedPoint found;
  found.point.position = sight->ray.origin + hit->distance * sight->ray.direction;
  found.point.normal = hit->normal;
  found.depth = (sight->T_camera_world * found.point.position).z();
  const SceneSpec& scene = spec.scenery->scene;
  if (!(found.depth >= scene.nearest && found.depth <= scene.farthest)) return std::nullopt;
  return found;
}

// The point among some in view whose 1 / depth is nearest to a random one.
ScenePoint DrawStillPoint(const SimulationSpec& spec,
                          const Observer& observer,
                          const std::vector<const RigInstant*>& used,
                          const SceneShape& still,
                          size_t index) {
  constexpr int kCandidates = 8, kTries = 2000;
  const SceneSpec& scene = spec.scenery->scene;
  Random random(spec.seed, "scene point", {index});
  const double wanted = random.Uniform(1 / scene.farthest, 1 / scene.nearest);
  std::optional<SightedPoint> best;
  int found = 0;
  for (int attempt = 0; attempt < kTries && found < kCandidates; ++attempt) {
    const auto sighted = SightPoint(spec, observer, used, still, &random);
    if (!sighted) continue;
    ++found;
    if (!best || std::abs(1 / sighted->depth - wanted) < std::abs(1 / best->depth - wanted)) {
      best = sighted;
    }
  }
  if (!best) {
    throw JobError(
        "{}: scene: the cameras see no surface at depths from {} to {} m; correct "
        "'near', 'far' or the trajectory",
        spec.path.string(),
        scene.nearest,
        scene.farthest);
  }
  return best->point;
}

// On the faces of a moving box, even over their area.
ScenePoint DrawOnBox(const MovingBox& moving, Random* random) {
  ScenePoint point;
  const Eigen::Vector3d& half = moving.box.half;
  const Eigen::Vector3d areas(half.y() * half.z(), half.z() * half.x(), half.x() * half.y());
  double drawn = random->Uniform(0, areas.sum());
  int axis = 0;
  while (axis < 2 && drawn > areas[axis]) drawn -= areas[axis++];
  const double side = random->Uniform(0, 1) < 0.5 ? -1 : 1;
  for (int i = 0; i < 3; ++i) point.position[i] = half[i] * random->Uniform(-1, 1);
  point.position[axis] = side * half[axis];
  point.normal[axis] = side;
  return point;
}

// On a face that the rig sees which the box was placed before.
ScenePoint DrawMovingPoint(const SimulationSpec& spec, const SimulatedScene& scene, size_t index) {
  Random random(spec.seed, "moving point", {index});
  const size_t box = index % scene.Moving().size();
  const MovingBox& moving = scene.Moving()[box];
  const Eigen::Vector3d viewer = moving.box.T_world_box.Inverse() * moving.viewer;
  ScenePoint point = DrawOnBox(moving, &random);
  while (!(point.normal.dot(viewer - point.position) > 0)) point = DrawOnBox(moving, &random);
  point.box = box;
  return point;
}

// The copy of each point one period back, and which of the two the end segment takes for the other.
void AddCopies(const SimulationSpec& spec, double period, std::vector<ScenePoint>* points) {
  constexpr double kMistaken = 0.45;
  const RigidTransform back{ExpRotation({0, 0, -period}), Eigen::Vector3d::Zero()};
  const size_t count = points->size();
  for (size_t i = 0; i < count; ++i) {
    ScenePoint copy = (*points)[i];
    if (copy.box) continue;
    copy.position = back * copy.position;
    copy.normal = back.R * copy.normal;
    copy.number = static_cast<int>(2 * count + i);  // after those that do not merge
    copy.number_at_end = copy.number;
    if (Random(spec.seed, "mistaken", {i}).Uniform(0, 1) < kMistaken) {
      (*points)[i].number_at_end = copy.number;
      copy.number_at_end.reset();
    }
    points->push_back(copy);
  }
}

// When a track is lost and found again: alternating spans of frames, exponentially distributed.
class TrackSpans {
 public:
  TrackSpans(double mean, size_t frames, Random* random) {
    if (!(mean > 0)) return;
    lost_first_ = random->Uniform(0, 1) < 0.5;
    for (double at = 0; at < static_cast<double>(frames);) {
      at -= mean * std::log(1 - random->Uniform(0, 1));
      changes_.push_back(at);
    }
  }
  [[nodiscard]] bool IsLost(size_t frame) const {
    const auto passed =
        std::upper_bound(changes_.begin(), changes_.end(), static_cast<double>(frame)) -
        changes_.begin();
    return lost_first_ != (passed % 2 == 1);
  }

 private:
  bool lost_first_ = false;
  std::vector<double> changes_;  // frames
};

// The exact observations of one camera in one frame, grouped by point.
struct ExactView {
  std::vector<size_t> points;
  std::vector<std::vector<Observation>> observations;
};

class Tracker {
 public:
  Tracker(const SimulationSpec& spec,
          const Observer& observer,
          const SimulatedScene& scene,
          const std::vector<ScenePoint>& points,
          size_t camera,
          size_t frames)
      : spec_(spec), observer_(observer), scene_(scene), points_(points), camera_(camera) {
    for (size_t i = 0; i < points.size(); ++i) {
      Random random(spec.seed, "track", {camera, i});
      spans_.emplace_back(spec.scenery->scene.track_length, frames, &random);
    }
  }

  [[nodiscard]] ExactView See(const RigInstant& instant, size_t frame) const {
    const RigidTransform T_camera_world =
        spec_.cameras[camera_].T_camera_rig * instant.T_world_rig.Inverse();
    const Eigen::Vector3d viewer = T_camera_world.Inverse().t;
    const SceneSpec& limits = spec_.scenery->scene;
    // Beside the axis things are farther than their depth.
    const SceneShape around = scene_.At(instant.time, viewer, 2 * limits.farthest);
    std::vector<RigidTransform> T_world_box;
    for (const MovingBox& moving : scene_.Moving()) {
      T_world_box.push_back(moving.At(instant.time).T_world_box);
    }
    ExactView view;
    for (size_t i = 0; i < points_.size(); ++i) {
      const ScenePoint& point = points_[i];
      const std::optional<int> number = NumberIn(point, instant.part);
      if (!number) continue;
      const RigidTransform T = point.box ? T_world_box[*point.box] : RigidTransform{};
      const Eigen::Vector3d position = T * point.position;
      const Eigen::Vector3d p_cam = T_camera_world * position;
      if (!(p_cam.z() >= limits.nearest && p_cam.z() <= limits.farthest)) continue;
      if (!((T.R * point.normal).dot(viewer - position) > 0) || spans_[i].IsLost(frame)) continue;
      auto seen = observer_.ObservePoint(camera_, *number, p_cam);
      if (seen.empty() || around.Hides(position, viewer)) continue;
      view.points.push_back(i);
      view.observations.push_back(std::move(seen));
    }
    return view;
  }

  // Adds noise, and takes some points for others.
  [[nodiscard]] View Measure(const ExactView& exact,
                             const std::string& name,
                             size_t frame,
                             std::vector<int>* wrong) const {
    Random random(spec_.seed, "tracks", {camera_, frame});
    const CameraSpec& camera = spec_.cameras[camera_];
    const size_t count = exact.points.size();
    View view{.frame = name, .observations = {}};
    for (size_t i = 0; i < count; ++i) {
      size_t source = i;
      if (random.Uniform(0, 1) < spec_.scenery->scene.wrong_matches && count > 1) {
        source = (i + 1 + static_cast<size_t>(random.Uniform(0, static_cast<double>(count - 1)))) %
                 count;
        wrong->push_back(exact.observations[i].front().marker);
      }
      for (Observation observation : exact.observations[source]) {
        observation.marker = exact.observations[i].front().marker;
        AddNoise(camera, &random, &observation);
        view.observations.push_back(observation);
      }
    }
    return view;
  }

 private:
  static std::optional<int> NumberIn(const ScenePoint& point, Part part) {
    return part == Part::kEnd ? point.number_at_end : point.number;
  }

  const SimulationSpec& spec_;
  const Observer& observer_;
  const SimulatedScene& scene_;
  const std::vector<ScenePoint>& points_;
  size_t camera_;
  std::vector<TrackSpans> spans_;
};

}  // namespace

std::vector<ScenePoint> DrawPoints(const SimulationSpec& spec,
                                   const Observer& observer,
                                   const RigPath& path,
                                   const SimulatedScene& scene) {
  const SceneSpec& wanted = spec.scenery->scene;
  const auto count = static_cast<size_t>(wanted.points);
  const auto moving =
      scene.Moving().empty() ? 0 : static_cast<size_t>(std::lround(wanted.moving * wanted.points));
  const std::vector<const RigInstant*> used = path.Used();
  std::vector<ScenePoint> points;
  for (size_t i = 0; i < count; ++i) {
    ScenePoint point = i + moving < count ? DrawStillPoint(spec, observer, used, scene.Still(), i)
                                          : DrawMovingPoint(spec, scene, i);
    point.number = static_cast<int>(i);
    const bool merges = Random(spec.seed, "merged", {i}).Uniform(0, 1) < wanted.merged;
    point.number_at_end = static_cast<int>(merges ? i : i + count);
    points.push_back(point);
  }
  if (scene.Period() > 0) AddCopies(spec, scene.Period(), &points);
  return points;
}

CameraTracks TrackPoints(const SimulationSpec& spec,
                         const Observer& observer,
                         const RigPath& path,
                         const SimulatedScene& scene,
                         const std::vector<ScenePoint>& points,
                         size_t camera,
                         int threads) {
  const std::vector<const RigInstant*> used = path.Used();
  const Tracker tracker(spec, observer, scene, points, camera, used.size());
  CameraTracks tracks;
  tracks.views.resize(used.size());
  std::vector<std::vector<int>> wrong(used.size());
  std::vector<std::vector<size_t>> seen(used.size());
  ParallelFor(used.size(), threads, [&](size_t f) {
    ExactView exact = tracker.See(*used[f], f);
    tracks.views[f] = tracker.Measure(exact, used[f]->name, f, &wrong[f]);
    seen[f] = std::move(exact.points);
  });
  tracks.observed.assign(points.size(), 0);
  for (size_t f = 0; f < used.size(); ++f) {
    for (const int marker : wrong[f]) tracks.wrong.emplace_back(used[f]->name, marker);
    for (const size_t point : seen[f]) ++tracks.observed[point];
  }
  return tracks;
}

}  // namespace plenocal::simulate
