// SPDX-License-Identifier: Apache-2.0
#include "engine/resample/rectify.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "calib/base/error.h"
#include "calib/camera/rays.h"
#include "models/registry.h"
#include "tests/calib/random.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

CalibratedCamera Camera(const std::string& name, const RigidTransform& T_camera_rig) {
  return {.name = name,
          .model = FindModel(CameraModels(), "pinhole"),
          .image_size = {640, 480},
          .config = {},
          .params = {500, 505, 322, 241},
          .covariance = Eigen::MatrixXd::Zero(4, 4),
          .T_camera_rig = T_camera_rig};
}

// A camera at a place in the rig, turned by a rotation vector.
CalibratedCamera CameraAt(const std::string& name,
                          const Eigen::Vector3d& centre,
                          const Eigen::Vector3d& w) {
  return Camera(name, RigidTransform{ExpRotation(w), centre}.Inverse());
}

Eigen::Vector2d ProjectInto(const CalibratedCamera& camera, const Eigen::Vector3d& p) {
  Eigen::Vector2d u;
  EXPECT_TRUE(Project(camera, nullptr, p, u.data()));
  return u;
}

constexpr double kRounding = 1e-9;

// Points in both views: one row, and columns apart by f b / Z.
void ExpectRectified(const CalibratedCamera& first,
                     const CalibratedCamera& second,
                     const RectifiedPair& pair) {
  EXPECT_EQ(pair.views[0].name, first.name);
  EXPECT_EQ(pair.views[1].name, second.name);
  EXPECT_EQ(pair.views[0].params, pair.views[1].params);
  EXPECT_EQ(pair.views[0].image_size, pair.views[1].image_size);
  EXPECT_EQ(pair.views[0].T_camera_rig.t.norm(), 0);
  EXPECT_LT((pair.views[1].T_camera_rig.t - Eigen::Vector3d(-pair.baseline, 0, 0)).norm(),
            kRounding);
  EXPECT_NEAR(std::abs(pair.baseline),
              (first.T_camera_rig.Inverse().t - second.T_camera_rig.Inverse().t).norm(),
              kRounding);
  testing::Random random(2);
  for (int i = 0; i < 20; ++i) {
    const Eigen::Vector3d in_rig = random.Uniforms<3>(-0.3, 0.3) + Eigen::Vector3d(0, 0, 2);
    const std::array cameras{&first, &second};
    std::array<Eigen::Vector2d, 2> u;
    std::array<Eigen::Vector3d, 2> p;
    for (size_t c = 0; c < 2; ++c) {
      p[c] = pair.R_view_camera[c] * (cameras[c]->T_camera_rig * in_rig);
      u[c] = ProjectInto(pair.views[c], p[c]);
      // The view's pose, and its projection matrix.
      EXPECT_LT((pair.views[c].T_camera_rig * p[0] - p[c]).norm(), kRounding);
      const std::array<double, 12> P = pair.ProjectionMatrix(c);
      const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> matrix(P.data());
      EXPECT_LT(((matrix * p[0].homogeneous()).hnormalized() - u[c]).norm(), 1e-6);
    }
    EXPECT_NEAR(u[0].y(), u[1].y(), 1e-6);
    EXPECT_NEAR(u[0].x() - u[1].x(), pair.views[0].params[0] * pair.baseline / p[0].z(), 1e-6);
  }
}

TEST(Rectify, GivesViewsWhoseRowsCorrespond) {
  const CalibratedCamera left = CameraAt("left", {0, 0, 0}, {0.02, 0.03, -0.01});
  const CalibratedCamera right = CameraAt("right", {0.1, 0.01, -0.02}, {-0.02, -0.05, 0.03});
  const RectifiedPair pair = Rectify(left, right, {});
  EXPECT_FALSE(pair.turned);
  EXPECT_GT(pair.baseline, 0);
  EXPECT_EQ(pair.views[0].image_size, (ImageSize{640, 480}));
  ExpectRectified(left, right, pair);
  // Views are upright whichever camera is the first.
  const RectifiedPair swapped = Rectify(right, left, {});
  EXPECT_NEAR(swapped.baseline, -pair.baseline, kRounding);
  ExpectRectified(right, left, swapped);
  for (const Eigen::Matrix3d& R : pair.R_view_camera) EXPECT_GT(R.diagonal().minCoeff(), 0.9);
  for (const Eigen::Matrix3d& R : swapped.R_view_camera) EXPECT_GT(R.diagonal().minCoeff(), 0.9);
}

TEST(Rectify, TurnsCamerasAboveEachOther) {
  const CalibratedCamera lower = CameraAt("lower", {0, 0, 0}, {0, 0.01, 0.02});
  const CalibratedCamera upper = CameraAt("upper", {0.01, -0.1, 0}, {0.01, 0, 0});
  for (const bool upper_first : {false, true}) {
    const CalibratedCamera& first = upper_first ? upper : lower;
    const CalibratedCamera& second = upper_first ? lower : upper;
    const RectifiedPair pair = Rectify(first, second, {});
    EXPECT_TRUE(pair.turned);
    EXPECT_GT(pair.baseline, 0) << "disparities are positive";
    EXPECT_EQ(pair.views[0].image_size, (ImageSize{480, 640}));
    ExpectRectified(first, second, pair);
    EXPECT_EQ(Rectify(first, second, {.size = ImageSize{300, 200}, .fov = {}, .balance = {}})
                  .views[1]
                  .image_size,
              (ImageSize{300, 200}));
  }
}

TEST(Rectify, RefusesOnePlaceAndCamerasInFrontOfEachOther) {
  const CalibratedCamera first = CameraAt("a", {0, 0, 0}, {0, 0, 0});
  const auto refusal = [&](const Eigen::Vector3d& centre, const Eigen::Vector3d& w) {
    return testing::RefusalOf([&] { Rectify(first, CameraAt("b", centre, w), {}); },
                              ErrorKind::kJob);
  };
  EXPECT_EQ(refusal({0, 0, 0}, {0, 0.1, 0}),
            "cameras 'a' and 'b' stand in one place, so that they cannot be rectified");
  const std::string in_front =
      "cameras 'a' and 'b' look along their baseline or at each other, so that they cannot be "
      "rectified";
  EXPECT_EQ(refusal({0.009, 0, 0.1}, {0, 0, 0}), in_front);
  EXPECT_EQ(refusal({0.011, 0, 0.1}, {0, 0, 0}), "no refusal");
}

TEST(MeasureEpipolarErrors, AreTheDifferencesOfRows) {
  const CalibratedCamera left = CameraAt("left", {0, 0, 0}, {0, 0, 0});
  const CalibratedCamera right = CameraAt("right", {0.1, 0, 0}, {0, 0, 0});
  const RectifiedPair pair = Rectify(left, right, {});
  std::array<std::vector<View>, 2> views;
  const std::vector<double> errors{0.5, -1, 0.25};  // px, in rows of the second camera
  for (size_t f = 0; f < 3; ++f) {
    const Eigen::Vector3d p(0.1 * static_cast<double>(f), 0.05, 1.5);
    for (size_t c = 0; c < 2; ++c) {
      const Eigen::Vector3d in_camera =
          c == 0 ? p : Eigen::Vector3d(p - Eigen::Vector3d(0.1, 0, 0));
      const Eigen::Vector2d u = ProjectInto(left, in_camera);
      Observation seen{.marker = 7};
      seen.values[0] = u.x();
      seen.values[1] = u.y() + (c == 1 ? errors[f] : 0);
      View view{.frame = std::to_string(f), .observations = {seen}};
      // A marker that the other camera does not see there.
      seen.marker = c == 0 ? 8 : 9;
      view.observations.push_back(seen);
      views[c].push_back(view);
    }
  }
  views[1].push_back({.frame = "alone", .observations = views[1][0].observations});
  // One scale: rows of the views are those of the cameras times f / f_y.
  const double scale = pair.views[0].params[1] / 505;
  const EpipolarErrors found = MeasureEpipolarErrors(pair, {&left, &right}, views);
  EXPECT_EQ(found.points, 3U);
  EXPECT_EQ(found.frames, 3U);
  EXPECT_NEAR(found.mean_absolute, scale * 1.75 / 3, 1e-9);
  EXPECT_NEAR(found.rms, scale * std::sqrt((0.25 + 1 + 0.0625) / 3), 1e-9);
  EXPECT_NEAR(found.largest, scale, 1e-9);
  EXPECT_EQ(MeasureEpipolarErrors(pair, {&left, &right}, {}).points, 0U);
}

}  // namespace TEST_FILE
}  // namespace plenocal
