// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/scene/scene_shape.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "apps/simulate/spec/random.h"

namespace plenocal::simulate {
namespace {

// Where a ray enters a box; nothing if it starts within the box or misses it.
std::optional<SurfaceHit> EnterBox(const Box& box,
                                   const Eigen::Vector3d& origin,
                                   const Eigen::Vector3d& direction) {
  const Eigen::Vector3d o = box.T_world_box.R.transpose() * (origin - box.T_world_box.t);
  const Eigen::Vector3d d = box.T_world_box.R.transpose() * direction;
  double enter = -std::numeric_limits<double>::infinity();
  double leave = std::numeric_limits<double>::infinity();
  int axis = 0;
  for (int i = 0; i < 3; ++i) {
    const double a = (-box.half[i] - o[i]) / d[i], b = (box.half[i] - o[i]) / d[i];
    if (std::min(a, b) > enter) enter = std::min(a, b), axis = i;
    leave = std::min(leave, std::max(a, b));
  }
  if (!(enter > 0 && enter < leave)) return std::nullopt;
  return SurfaceHit{enter, box.T_world_box.R.col(axis) * (d[axis] > 0 ? -1 : 1)};
}

Eigen::Matrix3d AboutVertical(double angle) { return ExpRotation({0, 0, angle}); }

// A box whose middle is at `centre`, of a size that suits its distance.
Box DrawBox(const Eigen::Vector3d& centre, double distance, Random* random) {
  Box box;
  box.T_world_box.t = centre;
  // Drawn one after the other: compilers differ in which operand of `*` they evaluate first.
  const Eigen::Matrix3d tilted =
      ExpRotation({random->Uniform(-0.3, 0.3), random->Uniform(-0.3, 0.3), 0});
  box.T_world_box.R = AboutVertical(random->Uniform(0, 2 * std::numbers::pi)) * tilted;
  for (int i = 0; i < 3; ++i) box.half[i] = distance * random->Uniform(0.05, 0.14);
  return box;
}

// Uniform in 1 / depth, which is the effect of depth on an image.
double DrawDepth(const SceneSpec& spec, Random* random) {
  return 1 / random->Uniform(1 / spec.farthest, 1 / spec.nearest);
}

// The middle of a box before one of the cameras, and its depth, m.
struct BoxPlace {
  const RigInstant* instant = nullptr;
  Eigen::Vector3d centre{0, 0, 0};
  double depth = 0;
};

// Nothing if surfaces of `still` would hide it.
std::optional<BoxPlace> DrawPlace(const SimulationSpec& spec,
                                  const Observer& observer,
                                  const std::vector<const RigInstant*>& instants,
                                  const SceneShape& still,
                                  Random* random) {
  const auto sight = DrawSight(spec, observer, instants, random);
  const double depth = DrawDepth(spec.scenery->scene, random);
  if (!sight) return std::nullopt;
  const double slope = sight->T_camera_world.R.row(2).dot(sight->ray.direction);
  if (!(slope > 0)) return std::nullopt;
  const auto hit = still.Cast(sight->ray.origin, sight->ray.direction);
  if (!hit || hit->distance < depth / slope) return std::nullopt;
  return BoxPlace{sight->instant, sight->ray.origin + depth / slope * sight->ray.direction, depth};
}

// Boxes that nobody runs into.
std::vector<Box> DrawBoxes(const SimulationSpec& spec,
                           const Observer& observer,
                           const std::vector<const RigInstant*>& instants,
                           const SceneShape& room,
                           int count) {
  constexpr int kTries = 50;
  std::vector<Box> boxes;
  for (int i = 0; i < count; ++i) {
    Random random(spec.seed, "box", {static_cast<size_t>(i)});
    for (int attempt = 0; attempt < kTries; ++attempt) {
      const auto place = DrawPlace(spec, observer, instants, room, &random);
      if (!place) continue;
      const Box box = DrawBox(place->centre, place->depth, &random);
      const double free = 0.6 * spec.scenery->scene.nearest + box.half.norm();
      const bool stands_free = std::ranges::all_of(instants, [&](const RigInstant* instant) {
        return (instant->T_world_rig.t - box.T_world_box.t).norm() > free;
      });
      if (!stands_free) continue;
      boxes.push_back(box);
      break;
    }
  }
  return boxes;
}

// Some tens of points lie on each.
std::vector<MovingBox> DrawMovingBoxes(const SimulationSpec& spec,
                                       const Observer& observer,
                                       const std::vector<const RigInstant*>& instants,
                                       const SceneShape& still) {
  constexpr double kPointsPerBox = 30;
  const SceneSpec& scene = spec.scenery->scene;
  const auto count = static_cast<size_t>(
      std::ceil(scene.moving * static_cast<double>(scene.points) / kPointsPerBox));
  std::vector<MovingBox> boxes;
  for (size_t i = 0; i < count; ++i) {
    Random random(spec.seed, "moving box", {i});
    std::optional<BoxPlace> place;
    for (int attempt = 0; attempt < 100 && !place; ++attempt) {
      place = DrawPlace(spec, observer, instants, still, &random);
    }
    if (!place) continue;
    const double course = random.Uniform(0, 2 * std::numbers::pi);
    const double speed = place->depth * random.Uniform(0.05, 0.2);
    // Some go along with the rig and stay long in view.
    const double along = random.Uniform(0, 1);
    boxes.push_back({.box = DrawBox(place->centre, place->depth, &random),
                     .time = place->instant->time,
                     .velocity = along * place->instant->velocity +
                                 speed * Eigen::Vector3d(std::cos(course), std::sin(course), 0),
                     .turning = random.Uniform(-0.5, 0.5),
                     .viewer = place->instant->T_world_rig.t});
  }
  return boxes;
}

// Some of the instants of the whole path, close enough to keep boxes off it.
std::vector<const RigInstant*> Sparse(const RigPath& path) {
  constexpr size_t kMost = 1000;
  const size_t step = path.instants.size() / kMost + 1;
  std::vector<const RigInstant*> instants;
  for (size_t i = 0; i < path.instants.size(); i += step) instants.push_back(&path.instants[i]);
  return instants;
}

}  // namespace

Box MovingBox::At(double t) const {
  Box moved = box;
  moved.T_world_box.t += (t - time) * velocity;
  moved.T_world_box.R = AboutVertical((t - time) * turning) * moved.T_world_box.R;
  return moved;
}

std::optional<SurfaceHit> SceneShape::Cast(const Eigen::Vector3d& origin,
                                           const Eigen::Vector3d& direction) const {
  SurfaceHit nearest{.distance = std::numeric_limits<double>::infinity()};
  for (const Wall& wall : walls) {
    const double towards = wall.normal.dot(direction);
    const double gap = wall.offset - wall.normal.dot(origin);
    if (gap < 0) return std::nullopt;
    if (towards > 0 && gap / towards < nearest.distance) nearest = {gap / towards, -wall.normal};
  }
  for (const Box& box : boxes) {
    const auto hit = EnterBox(box, origin, direction);
    if (hit && hit->distance < nearest.distance) nearest = *hit;
  }
  if (std::isinf(nearest.distance)) return std::nullopt;
  return nearest;
}

bool SceneShape::Hides(const Eigen::Vector3d& point, const Eigen::Vector3d& viewer) const {
  // Share of the distance: a surface does not hide its own points.
  constexpr double kRounding = 1e-7;
  const Eigen::Vector3d sight = point - viewer;
  for (const Wall& wall : walls) {
    if (wall.normal.dot(point) - wall.offset > kRounding * sight.norm()) return true;
  }
  return std::ranges::any_of(boxes, [&](const Box& box) {
    const auto hit = EnterBox(box, viewer, sight);
    return hit && hit->distance < 1 - kRounding;
  });
}

SimulatedScene::SimulatedScene(const SimulationSpec& spec,
                               const Observer& observer,
                               const RigPath& path) {
  const ScenerySpec& scenery = *spec.scenery;
  if (scenery.trajectory.repeated) {
    // Three times in the start segment, so that its scene is seen again one period off.
    const double period = scenery.trajectory.segment * scenery.trajectory.speed / 3;
    period_ = 2 * std::numbers::pi / std::max(3.0, std::round(path.circumference / period));
  }
  BuildRoom(scenery, path);
  const std::vector<const RigInstant*> instants = Sparse(path);
  // Some ten in every view, for a camera that stays in its place too.
  constexpr double kFewest = 48, kBoxesPerRange = 12;
  const int count = scenery.scene.boxes.value_or(static_cast<int>(
      std::max(kFewest, kBoxesPerRange * path.circumference / scenery.scene.farthest)));
  if (period_ == 0) {
    still_.boxes = DrawBoxes(spec, observer, instants, still_, count);
  } else {
    const double copies = 2 * std::numbers::pi / period_;
    const auto first =
        DrawBoxes(spec, observer, instants, still_, static_cast<int>(std::ceil(count / copies)));
    for (int k = 0; k < static_cast<int>(std::lround(copies)); ++k) {
      const RigidTransform turn{AboutVertical(k * period_), Eigen::Vector3d::Zero()};
      for (const Box& box : first) still_.boxes.push_back({turn * box.T_world_box, box.half});
    }
  }
  moving_ = DrawMovingBoxes(spec, observer, path.Used(), still_);
}

// Walls in many directions, each as far outside of the path, a floor and a ceiling.
void SimulatedScene::BuildRoom(const ScenerySpec& spec, const RigPath& path) {
  // At least; a room for one depth is all but round.
  const double least = spec.trajectory.one_depth ? 96 : 24;
  const double copies = period_ > 0 ? std::round(2 * std::numbers::pi / period_) : 1;
  const int count = static_cast<int>(copies * std::ceil(least / copies));
  const double gap = spec.trajectory.one_depth ? std::sqrt(spec.scene.nearest * spec.scene.farthest)
                                               : 0.9 * spec.scene.farthest;
  const double height = 0.45 * spec.scene.farthest;
  const auto farthest = [&](const Eigen::Vector3d& normal) {
    double offset = -std::numeric_limits<double>::infinity();
    for (const RigInstant& instant : path.instants) {
      offset = std::max(offset, normal.dot(instant.T_world_rig.t));
    }
    return offset;
  };
  for (int i = 0; i < count; ++i) {
    const double angle = 2 * std::numbers::pi * i / count;
    const Eigen::Vector3d normal(std::cos(angle), std::sin(angle), 0);
    still_.walls.push_back({normal, farthest(normal) + gap});
  }
  if (period_ > 0) {
    // The winding reaches differently far in each direction; the room shall not.
    const double offset = std::ranges::max(still_.walls, {}, &Wall::offset).offset;
    for (Wall& wall : still_.walls) wall.offset = offset;
  }
  for (const double side : {-1.0, 1.0}) {
    const Eigen::Vector3d normal(0, 0, side);
    still_.walls.push_back({normal, farthest(normal) + height});
  }
}

SceneShape SimulatedScene::At(double time, const Eigen::Vector3d& viewer, double reach) const {
  SceneShape shape{.walls = still_.walls, .boxes = {}};
  const auto add = [&](const Box& box) {
    if ((box.T_world_box.t - viewer).norm() - box.half.norm() < reach) shape.boxes.push_back(box);
  };
  for (const Box& box : still_.boxes) add(box);
  for (const MovingBox& moving : moving_) add(moving.At(time));
  return shape;
}

std::optional<RandomSight> DrawSight(const SimulationSpec& spec,
                                     const Observer& observer,
                                     const std::vector<const RigInstant*>& instants,
                                     Random* random) {
  const auto index = [&](size_t count) {
    return std::min(count - 1, static_cast<size_t>(random->Uniform(0, static_cast<double>(count))));
  };
  const size_t c = index(spec.cameras.size());
  const CameraSpec& camera = spec.cameras[c];
  RandomSight sight{.instant = instants[index(instants.size())], .T_camera_world = {}, .ray = {}};
  const double x = random->Uniform(0, camera.image_size[0] - 1.0);
  const double y = random->Uniform(0, camera.image_size[1] - 1.0);
  const std::optional<Ray> ray = observer.CentralRay(c, {x, y});
  if (!ray) return std::nullopt;
  sight.T_camera_world = camera.T_camera_rig * sight.instant->T_world_rig.Inverse();
  const RigidTransform T_world_camera = sight.T_camera_world.Inverse();
  sight.ray = {T_world_camera * ray->origin, T_world_camera.R * ray->direction};
  return sight;
}

}  // namespace plenocal::simulate
