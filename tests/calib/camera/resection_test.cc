// SPDX-License-Identifier: Apache-2.0
#include "calib/camera/resection.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace plenocal {
namespace TEST_FILE {

// Poses from exact rays: refined to rounding, times the lever of a small target (about 1000).
constexpr double kExact = 1e-9;

struct Scene {
  RigidTransform T_camera_target;
  std::vector<Eigen::Vector3d> points;
  std::vector<Ray> rays;
};

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double operator()(double sigma) { return sigma * normal_(engine_); }
  Eigen::Vector3d Vector(double sigma) {
    const double x = (*this)(sigma), y = (*this)(sigma), z = (*this)(sigma);
    return {x, y, z};
  }

 private:
  std::mt19937 engine_;
  std::normal_distribution<double> normal_;
};

std::vector<Eigen::Vector3d> Plane(int columns, int rows) {
  std::vector<Eigen::Vector3d> points;
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) points.emplace_back(0.05 * c, 0.05 * r, 0);
  }
  return points;
}

std::vector<Eigen::Vector3d> Cloud(size_t count, Random* random) {
  std::vector<Eigen::Vector3d> points(count);
  for (Eigen::Vector3d& point : points) point = random->Vector(0.1);
  return points;
}

// A target tilted by some 25 degrees about a random axis, 0.8 m before the camera.
Scene MakeScene(std::vector<Eigen::Vector3d> points, double noise_rad, Random* random) {
  Scene scene{.T_camera_target = {}, .points = std::move(points), .rays = {}};
  Eigen::Vector3d axis = random->Vector(1);
  axis.z() = 0;
  scene.T_camera_target.R =
      ExpRotation(0.45 * axis.normalized()) * ExpRotation({0, 0, (*random)(1)});
  scene.T_camera_target.t = Eigen::Vector3d((*random)(0.1), (*random)(0.1), 0.8);
  for (const Eigen::Vector3d& p : scene.points) {
    const Eigen::Vector3d p_cam = scene.T_camera_target * p;
    scene.rays.push_back(
        {.origin = Eigen::Vector3d::Zero(),
         .direction = (p_cam.normalized() + random->Vector(noise_rad)).normalized()});
  }
  return scene;
}

double AngleBetween(const RigidTransform& a, const RigidTransform& b) {
  return LogRotation(a.R * b.R.transpose()).norm();
}

void ExpectPose(const Scene& scene, double tolerance) {
  const auto found = Resect(scene.rays, scene.points);
  ASSERT_TRUE(found.has_value());
  EXPECT_LT(AngleBetween(found->T_camera_target, scene.T_camera_target), tolerance);
  EXPECT_LT((found->T_camera_target.t - scene.T_camera_target.t).norm(), tolerance);
}

TEST(Resect, FindsThePoseOfAPlane) {
  Random random(1);
  for (int i = 0; i < 50; ++i) ExpectPose(MakeScene(Plane(9, 6), 0, &random), kExact);
}

TEST(Resect, FindsThePoseOfAPlaneSeenFromTheFront) {
  Scene scene{.T_camera_target = {Eigen::Matrix3d::Identity(), {-0.2, -0.1, 0.8}},
              .points = Plane(9, 6),
              .rays = {}};
  for (const auto& p : scene.points) {
    scene.rays.push_back({.direction = (scene.T_camera_target * p).normalized()});
  }
  ExpectPose(scene,
             1e-6);  // the error is quadratic in the tilt: rounding 1e-16 is an angle of 1e-8
}

TEST(Resect, FindsThePoseOfASpatialTarget) {
  Random random(2);
  for (int i = 0; i < 50; ++i) ExpectPose(MakeScene(Cloud(20, &random), 0, &random), kExact);
}

TEST(Resect, FindsThePoseFromTheFourCornersOfOneTag) {
  Random random(3);
  for (int i = 0; i < 50; ++i) {
    ExpectPose(MakeScene({{0, 0, 0}, {0.1, 0, 0}, {0.1, 0.1, 0}, {0, 0.1, 0}}, 0, &random), kExact);
  }
}

TEST(Resect, FindsThePoseOfATargetThatSurroundsTheCamera) {
  Random random(4);
  for (int i = 0; i < 20; ++i) {
    Scene scene = MakeScene(Cloud(30, &random), 0, &random);
    scene.T_camera_target.t = Eigen::Vector3d(0.01, 0.02, -0.03);  // points on all sides
    for (size_t k = 0; k < scene.points.size(); ++k) {
      scene.rays[k].direction = (scene.T_camera_target * scene.points[k]).normalized();
    }
    ExpectPose(scene, kExact);
  }
}

TEST(Resect, FindsThePoseOfACameraWithoutASingleCentre) {
  Random random(5);
  for (int i = 0; i < 20; ++i) {
    for (const auto& points : {Plane(9, 6), Cloud(20, &random)}) {
      Scene scene = MakeScene(points, 0, &random);
      for (size_t k = 0; k < scene.points.size(); ++k) {
        Ray& ray = scene.rays[k];
        ray.origin = random.Vector(0.005);  // an aperture of a centimetre
        ray.direction = (scene.T_camera_target * scene.points[k] - ray.origin).normalized();
      }
      ExpectPose(scene, kExact);
    }
  }
}

TEST(Resect, IsNotPulledByAMisreadMarker) {
  Random random(6);
  for (int i = 0; i < 40; ++i) {
    SCOPED_TRACE(::testing::Message() << i);
    Scene scene = MakeScene(i % 4 < 2 ? Plane(9, 6) : Cloud(40, &random), 0, &random);
    // It is seen where another marker is: one with another's number, or two that swapped theirs.
    if (i % 2 == 0) {
      scene.rays[7] = scene.rays[31];
    } else {
      std::swap(scene.rays[7], scene.rays[31]);
    }
    ExpectPose(scene, 1e-3);  // Cauchy's weights leave a small pull
  }
}

TEST(Resect, ReportsTheNoiseOfItsRays) {
  Random random(7);
  constexpr double kNoise = 1e-3;  // rad; about a pixel at a focal length of 1000 px
  for (int i = 0; i < 30; ++i) {
    const Scene scene = MakeScene(i % 2 == 0 ? Plane(9, 6) : Cloud(40, &random), kNoise, &random);
    const auto found = Resect(scene.rays, scene.points);
    ASSERT_TRUE(found.has_value());
    // Two components a ray; 54 rays give their root mean square to about 10 %, here three times
    // that.
    EXPECT_NEAR(found->rms, std::sqrt(2) * kNoise, 0.3 * std::sqrt(2) * kNoise);
    // A plane 0.4 m wide in 0.8 m: the tilt is known to about 10 times the noise, here four sigma.
    EXPECT_LT(AngleBetween(found->T_camera_target, scene.T_camera_target), 40 * kNoise);
    EXPECT_LT((found->T_camera_target.t - scene.T_camera_target.t).norm(), 10 * kNoise);
  }
}

TEST(Resect, FindsNothingForTooFewPointsOrPointsOnALine) {
  Random random(8);
  const Scene scene = MakeScene(Plane(9, 6), 0, &random);
  for (size_t count = 0; count < 4; ++count) {
    EXPECT_FALSE(Resect(std::span(scene.rays).first(count), std::span(scene.points).first(count)));
  }
  EXPECT_FALSE(Resect(std::span(scene.rays).first(9), std::span(scene.points).first(9)))
      << "the first row is a line";
}

}  // namespace TEST_FILE
}  // namespace plenocal
