// SPDX-License-Identifier: Apache-2.0
//
// The scene's texture, and rays of a camera onto walls and boxes.
#include "apps/simulate/scene/scene_surface.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <set>

#include "apps/simulate/spec/random.h"
#include "tests/apps/simulate/small_scene.h"

namespace plenocal::simulate {
namespace TEST_FILE {

using Eigen::Vector3d;
using Eigen::Vector3f;

// The brightness of a point by the axes and the shift of its face.
Eigen::Vector2d TextureAt(const Vector3d& normal, const Vector3d& middle, const Vector3d& point) {
  const Vector3d aside = std::abs(normal.z()) < 0.9 ? Vector3d::UnitZ() : Vector3d::UnitX();
  const Vector3d u = aside.cross(normal).normalized(), v = normal.cross(u);
  const Vector3d start = 7.13 * normal + 3.71 * middle;
  return {u.dot(point) + start.x() + start.y() + start.z(), v.dot(point) + start.x() - start.y()};
}

TEST(SceneSurface, HasATextureOfItsContrastAtAllWidths) {
  constexpr double kTexel = 0.01;
  const SceneTexture texture(kTexel, 3);
  // Of points: mean and standard deviation; neighbours correlate, points far apart do not.
  const auto moments = [&](double width, double step) {
    double sum = 0, squares = 0, products = 0;
    constexpr int kSide = 60;
    for (int i = 0; i < kSide * kSide; ++i) {
      const auto u = static_cast<float>(0.37 * (i % kSide)),
                 v = static_cast<float>(0.41 * (i / kSide));
      const double a = texture.At(u, v, static_cast<float>(width)) - 0.45;
      const double b =
          texture.At(u + static_cast<float>(step), v, static_cast<float>(width)) - 0.45;
      sum += a, squares += a * a, products += a * b;
    }
    return std::array{sum / 3600, std::sqrt(squares / 3600), products / squares};
  };
  const auto fine = moments(0, kTexel / 8);
  EXPECT_NEAR(fine[0], 0, 0.03);
  EXPECT_NEAR(fine[1], 0.19, 0.03);  // less between texels
  EXPECT_GT(fine[2], 0.97);
  EXPECT_LT(std::abs(moments(0, 400 * kTexel)[2]), 0.1);
  // Wider spots: each octave that is averaged away takes an eighth of the variance.
  double last = fine[1];
  for (const double width : {2.5, 5.0, 10.0, 40.0, 160.0}) {
    const double now = moments(width * kTexel, 0)[1];
    EXPECT_LT(now, last) << width;
    last = now;
  }
  EXPECT_LT(last, 0.1);
  // The level changes where a spot is wider than two of its texels, up to 256 of them.
  const auto at = [&](double width) {
    return texture.At(0.1234f, 0.777f, static_cast<float>(width * kTexel));
  };
  EXPECT_EQ(at(0), at(1.99));
  EXPECT_NE(at(1.99), at(2.01));
  EXPECT_EQ(at(2.01), at(3.99));
  EXPECT_NE(at(3.99), at(4.01));
  EXPECT_NE(at(255), at(257));
  EXPECT_EQ(at(257), at(1e6));
  Digest digest;
  for (int i = 0; i < 200; ++i) {
    digest.Add(texture.At(static_cast<float>(0.13 * i - 9),
                          static_cast<float>(5 - 0.07 * i),
                          static_cast<float>(0.001 * i)));
  }
  EXPECT_NEAR(digest.Sum(), -1.29183, 1e-3);

  // Faces of a posed scene.
  SceneShape shape;
  shape.walls = {{{1, 0, 0}, 6}, {{0, 0, 1}, 2.5}, {{-0.6, 0.8, 0}, 4}};
  shape.boxes = {{{ExpRotation({0.2, 0.1, 0.5}), {3.5, 0.5, 0.2}}, {0.5, 0.8, 0.6}},
                 {{ExpRotation({0, 0, -0.4}), {4.5, -0.6, 0.4}}, {0.4, 0.4, 0.9}}};
  const RigidTransform T_camera_world{
      (Eigen::Matrix3d() << 0, -1, 0, 0, 0, -1, 1, 0, 0).finished() *
          ExpRotation({0.05, 0.1, -0.2}),
      {0.1, 0.2, -0.3}};
  const RigidTransform T_world_camera = T_camera_world.Inverse();
  const PosedScene posed(shape, T_camera_world, texture);
  Random random(1, "rays");
  std::set<int> faces;
  for (int i = 0; i < 600; ++i) {
    const Vector3f origin(static_cast<float>(random.Uniform(-0.1, 0.1)), 0.02f, 0.01f);
    const Vector3f direction(static_cast<float>(random.Uniform(-0.5, 0.6)),
                             static_cast<float>(random.Uniform(-0.5, 0.3)),
                             1);
    const Vector3d from = T_world_camera * origin.cast<double>(),
                   along = T_world_camera.R * direction.cast<double>();
    const auto hit = shape.Cast(from, along);
    const auto [face, distance] = posed.FaceOf(origin, direction);
    ASSERT_EQ(hit.has_value(), face >= 0);
    if (!hit) continue;
    EXPECT_NEAR(distance, hit->distance, 2e-4 * hit->distance);
    faces.insert(face);
    const Vector3d point = from + hit->distance * along;
    Eigen::Vector2d place;
    if (face < 3) {
      const Wall& wall = shape.walls[static_cast<size_t>(face)];
      EXPECT_LT((hit->normal + wall.normal).norm(), 1e-9);
      place = TextureAt(wall.normal, wall.offset * wall.normal, point);
    } else {
      const Box& box = shape.boxes[static_cast<size_t>(face - 3) / 6];
      const int axis = (face - 3) % 6 / 2;
      const Vector3d normal = ((face - 3) % 2 == 0 ? -1 : 1) * Vector3d::Unit(axis);
      EXPECT_LT((box.T_world_box.R * normal - hit->normal).norm(), 1e-9);
      place = TextureAt(normal, box.half[axis] * normal, box.T_world_box.Inverse() * point);
    }
    const Spread spread{.at_origin = -0.01f, .by_distance = 0.02f};
    const float width = std::abs(-0.01f + 0.02f * distance);
    const float radiance = posed.Radiance(origin, direction, spread);
    EXPECT_NEAR(radiance,
                texture.At(static_cast<float>(place.x()), static_cast<float>(place.y()), width),
                0.02);
    // The same of bundles, whose face is known or not.
    RayBundle rays;
    rays.count = 1;
    rays.z = origin.z();
    rays.x[0] = origin.x(), rays.y[0] = origin.y(), rays.dx[0] = direction.x(),
    rays.dy[0] = direction.y();
    std::array<float, RayBundle::kMost> by_face{}, alone{};
    posed.Radiances(rays, spread, face, &by_face);
    posed.Radiances(rays, spread, -1, &alone);
    EXPECT_EQ(alone[0], radiance);
    EXPECT_NEAR(by_face[0], radiance, 0.01);
  }
  EXPECT_GE(faces.size(), 6u);
  // Out of the open side of the room.
  EXPECT_EQ(posed.FaceOf(Vector3f::Zero(), {2, 1, -1}), (std::pair{-1, 0.f}));
  EXPECT_EQ(posed.Radiance(Vector3f::Zero(), {2, 1, -1}, {}), Surface::kBackground);
}

TEST(SceneSurface, HasTexelsOfHalfAPixelAtTheMiddleDepth) {
  SimulationSpec spec = SmallScene();
  for (CameraSpec& camera : spec.cameras) camera.params = {50, 50, 31.5, 23.5, 0, 0, 0};
  spec.cameras[1].params = {100, 100, 31.5, 23.5, 0, 0, 0};
  spec.scenery->scene.nearest = 2;
  spec.scenery->scene.farthest = 8;
  const SceneTexture texture = MakeSceneTexture(spec, Observer(spec));
  // Pixels of the finer camera are 0.01 rad, at 4 m 0.04 m; at twice a texel the level changes.
  const auto at = [&](double width) {
    return texture.At(0.1234f, 0.777f, static_cast<float>(width));
  };
  EXPECT_EQ(at(0), at(0.0398));
  EXPECT_NE(at(0), at(0.0402));
}

}  // namespace TEST_FILE
}  // namespace plenocal::simulate
