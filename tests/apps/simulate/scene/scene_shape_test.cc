// SPDX-License-Identifier: Apache-2.0
//
// Rays against walls and boxes by other formulas; rooms and boxes around paths.
#include "apps/simulate/scene/scene_shape.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

#include "apps/simulate/spec/random.h"
#include "tests/apps/simulate/small_scene.h"

namespace plenocal::simulate {
namespace TEST_FILE {

using Eigen::Vector3d;

constexpr double kPi = std::numbers::pi;

Box TiltedBox() { return {{ExpRotation({0.3, -0.4, 0.9}), {4, 1, -0.5}}, {0.6, 1.1, 0.8}}; }

// The nearest face whose rectangle the ray meets from outside.
std::optional<SurfaceHit> ByFaces(const Box& box,
                                  const Vector3d& origin,
                                  const Vector3d& direction) {
  std::optional<SurfaceHit> nearest;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {-1.0, 1.0}) {
      const Vector3d normal = side * box.T_world_box.R.col(axis);
      const double slope = normal.dot(direction);
      if (slope >= 0) continue;  // the back of this face
      const double distance =
          (normal.dot(box.T_world_box.t) + box.half[axis] - normal.dot(origin)) / slope;
      const Vector3d at = box.T_world_box.Inverse() * (origin + distance * direction);
      bool inside = distance > 0;
      for (const int other : {(axis + 1) % 3, (axis + 2) % 3}) {
        inside = inside && std::abs(at[other]) <= box.half[other];
      }
      if (inside && (!nearest || distance < nearest->distance)) nearest = {distance, normal};
    }
  }
  return nearest;
}

TEST(SceneShape, CastsRaysOntoTheNearestFaceOfABox) {
  SceneShape shape;
  shape.boxes = {TiltedBox(), {{Eigen::Matrix3d::Identity(), {8, 2, 0}}, {0.5, 2, 2}}};
  Random random(1, "rays");
  int first = 0, second = 0, none = 0;
  for (int i = 0; i < 400; ++i) {
    const Vector3d origin(random.Uniform(-2, 1), random.Uniform(-1, 1), random.Uniform(-1, 1));
    const Vector3d direction =
        2 * Vector3d(random.Uniform(-0.2, 1), random.Uniform(-0.4, 0.6), random.Uniform(-0.4, 0.4));
    const auto a = ByFaces(shape.boxes[0], origin, direction),
               b = ByFaces(shape.boxes[1], origin, direction);
    const auto& expected = !a || (b && b->distance < a->distance) ? b : a;
    const auto hit = shape.Cast(origin, direction);
    ASSERT_EQ(hit.has_value(), expected.has_value()) << i;
    ++(!hit ? none : expected->distance == (a ? a->distance : -1) ? first : second);
    if (!hit) continue;
    EXPECT_NEAR(hit->distance, expected->distance, 1e-12);
    EXPECT_LT((hit->normal - expected->normal).norm(), 1e-12);
  }
  EXPECT_GT(std::min({first, second, none}), 10);
  // From within a box and away from it.
  const Vector3d& middle = shape.boxes[0].T_world_box.t;
  shape.boxes.resize(1);
  EXPECT_FALSE(shape.Cast(middle, {1, 0, 0}));
  EXPECT_FALSE(shape.Cast(middle - Vector3d(5, 0, 0), {-1, 0, 0}));
  EXPECT_TRUE(shape.Cast(middle - Vector3d(5, 0, 0), {1, 0, 0}));
}

TEST(SceneShape, CastsRaysOntoTheNearestWallFromWithinTheRoom) {
  SceneShape shape;
  shape.walls = {{{1, 0, 0}, 5}, {{0, 1, 0}, 3}};
  const auto hit = shape.Cast({1, 0, 0}, {2, 0.5, 0});
  ASSERT_TRUE(hit);
  EXPECT_DOUBLE_EQ(hit->distance, 2);  // the other wall is 6 away
  EXPECT_EQ(hit->normal, Vector3d(-1, 0, 0));
  const auto other = shape.Cast({1, 0, 0}, {1, 1, 0});
  EXPECT_DOUBLE_EQ(other->distance, 3);
  EXPECT_EQ(other->normal, Vector3d(0, -1, 0));
  EXPECT_FALSE(shape.Cast({1, 0, 0}, {-1, -1, 0}));  // both are behind
  EXPECT_FALSE(shape.Cast({1, 0, 0}, {-1, 0, 0}));   // along one
  EXPECT_FALSE(shape.Cast({6, 0, 0}, {-1, 1, 0}));   // out of the room
  EXPECT_EQ(shape.Cast({5, 0, 0}, {1, 0, 0})->distance, 0);
  // A box before a wall, and one behind it.
  shape.boxes = {{{Eigen::Matrix3d::Identity(), {3, 0, 0}}, {1, 1, 1}}};
  EXPECT_DOUBLE_EQ(shape.Cast({0, 0, 0}, {1, 0, 0})->distance, 2);
  shape.boxes[0].T_world_box.t.x() = 9;
  EXPECT_DOUBLE_EQ(shape.Cast({0, 0, 0}, {1, 0, 0})->distance, 5);
}

TEST(SceneShape, HidesPointsBehindBoxesAndOutOfTheRoom) {
  SceneShape shape;
  shape.walls = {{{1, 0, 0}, 10}};
  shape.boxes = {{{Eigen::Matrix3d::Identity(), {5, 0, 0}}, {1, 1, 1}}};
  const Vector3d viewer(0, 0, 0);
  EXPECT_FALSE(shape.Hides({4, 0.5, 0.5}, viewer));  // on the front of the box itself
  EXPECT_TRUE(shape.Hides({6, 0.5, 0.5}, viewer));   // on its back
  EXPECT_FALSE(shape.Hides({3.99, 0, 0}, viewer));
  EXPECT_TRUE(shape.Hides({10, 0, 0}, viewer));
  EXPECT_FALSE(shape.Hides({10, 4, 0}, viewer));  // on the wall beside the box
  EXPECT_TRUE(shape.Hides({10.001, 4, 0}, viewer));
  EXPECT_FALSE(shape.Hides({10, 0, 0}, {7, 0, 0}));
}

TEST(SceneShape, OfABoxMovesAndTurnsSteadily) {
  const MovingBox moving{
      .box = TiltedBox(), .time = 2, .velocity = {1, 2, 3}, .turning = 0.5, .viewer = {}};
  const Box moved = moving.At(5);
  EXPECT_LT((moved.T_world_box.t - (TiltedBox().T_world_box.t + Vector3d(3, 6, 9))).norm(), 1e-12);
  EXPECT_LT(
      (moved.T_world_box.R - Eigen::AngleAxisd(1.5, Vector3d::UnitZ()) * TiltedBox().T_world_box.R)
          .norm(),
      1e-12);
  EXPECT_EQ(moved.half, TiltedBox().half);
}

// Along a square of 4 m; the circumference is as stated.
RigPath SquarePath(double circumference) {
  RigPath path;
  path.circumference = circumference;
  for (int i = 0; i < 40; ++i) {
    const double along = i % 10 * 0.4 - 2;
    RigInstant instant{.name = std::to_string(i),
                       .time = 0.5 * i,
                       .part = Part::kStart,
                       .used = i % 4 == 0,
                       .T_world_rig = {}};
    const RigidTransform turn{ExpRotation({0, 0, kPi / 2 * (i / 10)}), Vector3d::Zero()};
    instant.T_world_rig =
        turn * RigidTransform{(Eigen::Matrix3d() << 0, 0, 1, -1, 0, 0, 0, -1, 0).finished(),
                              {2, along, 0.1 * i}};
    instant.velocity = turn.R * Vector3d(0, 0.8, 0.2);
    path.instants.push_back(instant);
  }
  return path;
}

double Offset(const RigPath& path, const Vector3d& normal) {
  double offset = -1e9;
  for (const RigInstant& instant : path.instants)
    offset = std::max(offset, normal.dot(instant.T_world_rig.t));
  return offset;
}

TEST(SceneShape, OfARoomIsOutsideThePathByTheRangeOfDepths) {
  const RigPath path = SquarePath(33);
  for (const auto& [one_depth, repeated, segment, walls, gap, copies] :
       std::initializer_list<std::tuple<bool, bool, double, int, double, int>>{
           {false, false, 15, 24, 0.9 * 8, 0},
           {true, false, 15, 96, 4, 0},
           {false, true, 20, 25, 0.9 * 8, 5},     // 33 / (20 / 3) = 4.95
           {false, true, 60, 24, 0.9 * 8, 3}}) {  // 1.65: at least three
    SimulationSpec spec = SmallScene();
    spec.scenery->scene.nearest = 2;
    spec.scenery->scene.farthest = 8;
    spec.scenery->scene.boxes = 0;
    spec.scenery->trajectory.one_depth = one_depth;
    spec.scenery->trajectory.repeated = repeated;
    spec.scenery->trajectory.segment = segment;
    const SimulatedScene scene(spec, Observer(spec), path);
    const std::vector<Wall>& found = scene.Still().walls;
    ASSERT_EQ(found.size(), static_cast<size_t>(walls) + 2);
    EXPECT_DOUBLE_EQ(scene.Period(), copies > 0 ? 2 * kPi / copies : 0);
    double largest = 0;
    for (int i = 0; i < walls; ++i) {
      const double angle = 2 * kPi * i / walls;
      largest = std::max(largest, Offset(path, {std::cos(angle), std::sin(angle), 0}));
    }
    for (int i = 0; i < walls; ++i) {
      const double angle = 2 * kPi * i / walls;
      const Vector3d normal(std::cos(angle), std::sin(angle), 0);
      EXPECT_LT((found[static_cast<size_t>(i)].normal - normal).norm(), 1e-12);
      EXPECT_NEAR(found[static_cast<size_t>(i)].offset,
                  (repeated ? largest : Offset(path, normal)) + gap,
                  1e-12);
    }
    const Wall &floor = found[static_cast<size_t>(walls)], &ceiling = found.back();
    EXPECT_EQ(floor.normal, Vector3d(0, 0, -1));
    EXPECT_DOUBLE_EQ(floor.offset, 0.45 * 8);
    EXPECT_EQ(ceiling.normal, Vector3d(0, 0, 1));
    EXPECT_DOUBLE_EQ(ceiling.offset, 3.9 + 0.45 * 8);
    EXPECT_TRUE(scene.Still().boxes.empty() && scene.Moving().empty());
  }
}

double DigestOf(const Box& box) {
  Digest digest;
  digest.Add(box.T_world_box);
  digest.AddAll(box.half);
  return digest.Sum();
}

TEST(SceneShape, OfBoxesStandsBeforeTheCamerasAndOffThePath) {
  SimulationSpec spec = SmallScene();
  SceneSpec& wanted = spec.scenery->scene;
  wanted.nearest = 1;
  wanted.farthest = 5;
  wanted.boxes = 12;
  wanted.points = 100;
  wanted.moving = 0.61;
  const RigPath path = SquarePath(33);
  const Observer observer(spec);
  const SimulatedScene scene(spec, observer, path);
  ASSERT_EQ(scene.Still().boxes.size(), 12u);
  ASSERT_EQ(scene.Moving().size(), 3u);  // 61 points, 30 a box
  Digest still, moving;
  const auto expect_seen = [&](const Box& box, bool used) {
    bool seen = false;
    for (const RigInstant& instant : path.instants) {
      EXPECT_TRUE(used ||
                  (instant.T_world_rig.t - box.T_world_box.t).norm() > 0.6 + box.half.norm());
      for (size_t c = 0; c < 2; ++c) {
        const Vector3d p =
            spec.cameras[c].T_camera_rig * (instant.T_world_rig.Inverse() * box.T_world_box.t);
        // Its size is 5 to 14 % of the depth.
        seen =
            seen || (p.z() >= 1 && p.z() <= 5 && (!used || instant.used) &&
                     box.half.minCoeff() >= 0.05 * p.z() && box.half.maxCoeff() <= 0.14 * p.z() &&
                     !observer.ObservePoint(c, 0, p).empty());
      }
    }
    EXPECT_TRUE(seen);
  };
  for (const Box& box : scene.Still().boxes) {
    expect_seen(box, false);
    still.Add(DigestOf(box));
  }
  for (const MovingBox& box : scene.Moving()) {
    expect_seen(box.box, true);
    moving.AddAll(std::vector{DigestOf(box.box), box.time, box.turning});
    moving.AddAll(box.velocity);
    moving.AddAll(box.viewer);
    EXPECT_LE(std::abs(box.turning), 0.5);
    bool found = false;
    for (const RigInstant* instant : path.Used()) {
      if (instant->time != box.time) continue;
      found = true;
      EXPECT_EQ(box.viewer, instant->T_world_rig.t);
      // A share of the rig's velocity, which alone goes up, and 5 to 20 % of the depth a second.
      const double along = box.velocity.z() / 0.2;
      EXPECT_TRUE(along >= 0 && along <= 1);
      const double speed = (box.velocity - along * instant->velocity).norm();
      EXPECT_TRUE(speed >= 0.05 && speed <= 0.2 * 5) << speed;
    }
    EXPECT_TRUE(found);
  }
  // Existing sets keep their scenes.
  EXPECT_NEAR(still.Sum(), -6.5011508778, 1e-6);
  EXPECT_NEAR(moving.Sum(), 6.1039725647, 1e-6);

  // The scene within a reach at a time.
  const Vector3d viewer(2, 0, 1);
  for (const double reach : {0.0, 3.0, 1e9}) {
    std::vector<double> expected;
    const auto expect = [&](const Box& box) {
      if ((box.T_world_box.t - viewer).norm() < reach + box.half.norm())
        expected.push_back(DigestOf(box));
    };
    for (const Box& box : scene.Still().boxes) expect(box);
    for (const MovingBox& box : scene.Moving()) expect(box.At(7));
    const SceneShape near = scene.At(7, viewer, reach);
    EXPECT_EQ(near.walls.size(), 26u);
    std::vector<double> found;
    for (const Box& box : near.boxes) found.push_back(DigestOf(box));
    EXPECT_EQ(found, expected);
  }
  // As many boxes as the path needs.
  for (const auto& [circumference, count] : {std::pair{19.0, 48u}, std::pair{33.0, 79u}}) {
    wanted.boxes.reset();
    EXPECT_EQ(SimulatedScene(spec, observer, SquarePath(circumference)).Still().boxes.size(),
              count);
  }
}

TEST(SceneShape, OfARepeatedSceneHasItsBoxesInEachPeriod) {
  SimulationSpec spec = SmallScene();
  spec.scenery->scene.boxes = 11;
  spec.scenery->trajectory.repeated = true;
  spec.scenery->trajectory.segment = 20;
  const SimulatedScene scene(spec, Observer(spec), SquarePath(33));
  const std::vector<Box>& boxes = scene.Still().boxes;
  ASSERT_EQ(boxes.size(), 15u);  // three in each of five periods
  for (size_t i = 0; i + 3 < boxes.size(); ++i) {
    const RigidTransform turned =
        RigidTransform{ExpRotation({0, 0, 2 * kPi / 5}), Vector3d::Zero()} * boxes[i].T_world_box;
    EXPECT_LT((turned.t - boxes[i + 3].T_world_box.t).norm(), 1e-12);
    EXPECT_LT((turned.R - boxes[i + 3].T_world_box.R).norm(), 1e-12);
    EXPECT_EQ(boxes[i].half, boxes[i + 3].half);
  }
}

TEST(SceneShape, IsSightedThroughPixelsOfAllCamerasAndInstants) {
  const SimulationSpec spec = SmallScene();
  const Observer observer(spec);
  const RigPath path = SquarePath(33);
  const std::vector<const RigInstant*> used = path.Used();
  Random random(3, "sights");
  std::map<const RigInstant*, int> instants;
  std::array<int, 2> cameras{};
  Digest digest;
  double least_x = 64, most_x = 0, least_y = 48, most_y = 0;
  for (int i = 0; i < 200; ++i) {
    const auto sight = DrawSight(spec, observer, used, &random);
    ASSERT_TRUE(sight);
    ++instants[sight->instant];
    const RigidTransform T_camera_rig = sight->T_camera_world * sight->instant->T_world_rig;
    const size_t c = T_camera_rig.t.isZero(1e-9) ? 0 : 1;
    ++cameras[c];
    EXPECT_LT((T_camera_rig.t - spec.cameras[c].T_camera_rig.t).norm(), 1e-12);
    EXPECT_LT((sight->ray.origin - sight->T_camera_world.Inverse().t).norm(), 1e-12);
    const auto seen = observer.ObservePoint(
        c, 0, sight->T_camera_world * (sight->ray.origin + 3 * sight->ray.direction));
    ASSERT_EQ(seen.size(), 1u);
    digest.Add(seen[0].values[0] + 2 * seen[0].values[1]);
    least_x = std::min(least_x, seen[0].values[0]), most_x = std::max(most_x, seen[0].values[0]);
    least_y = std::min(least_y, seen[0].values[1]), most_y = std::max(most_y, seen[0].values[1]);
  }
  EXPECT_EQ(instants.size(), used.size());
  EXPECT_GT(std::min(cameras[0], cameras[1]), 60);
  EXPECT_TRUE(least_x >= 0 && least_x < 2 && most_x > 61 && most_x <= 63);
  EXPECT_TRUE(least_y >= 0 && least_y < 2 && most_y > 45 && most_y <= 47);
  EXPECT_NEAR(digest.Sum(), -497.19969, 1e-4);
}

}  // namespace TEST_FILE
}  // namespace plenocal::simulate
