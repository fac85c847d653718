// SPDX-License-Identifier: Apache-2.0
#include "engine/resample/pinhole_view.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "calib/base/error.h"
#include "models/registry.h"

namespace plenocal {
namespace TEST_FILE {

constexpr double kDegree = std::numbers::pi / 180;

/// An equidistant fisheye, r = f theta about the middle of the image.
SeenImage Fisheye(double f) {
  SeenImage image{.name = "fish", .size = {640, 480}, .direction = {}, .f = {f, f}, .c = {}};
  image.c = {319.5, 239.5};
  image.direction = [f](const Eigen::Vector2d& u) -> std::optional<Eigen::Vector3d> {
    const Eigen::Vector2d from = u - Eigen::Vector2d(319.5, 239.5);
    const double theta = from.norm() / f;
    const Eigen::Vector2d across =
        theta > 0 ? Eigen::Vector2d(std::sin(theta) * from.normalized()) : from;
    return Eigen::Vector3d(across.x(), across.y(), std::cos(theta));
  };
  return image;
}

SeenImage Pinhole(double f, const Eigen::Vector2d& c) {
  SeenImage image{.name = "pin", .size = {640, 480}, .direction = {}, .f = {f, f}, .c = c};
  image.direction = [f, c](const Eigen::Vector2d& u) -> std::optional<Eigen::Vector3d> {
    return Eigen::Vector3d(u.x() - c.x(), u.y() - c.y(), f);
  };
  return image;
}

void ExpectView(const CalibratedCamera& view, const std::array<double, 4>& expected) {
  EXPECT_EQ(view.model->name, "pinhole");
  ASSERT_EQ(view.params.size(), expected.size());
  for (size_t k = 0; k < expected.size(); ++k) EXPECT_NEAR(view.params[k], expected[k], 1e-6) << k;
}

TEST(PinholeView, KeepsScaleAndPrincipalPointOfOneCamera) {
  const std::vector images{Pinhole(500, {300, 260})};
  ExpectView(ChoosePinhole(images, {}), {500, 500, 300, 260});
  // Half the width decides, a third of the height is more; the middle stays the middle.
  const CalibratedCamera smaller = ChoosePinhole(images, {.size = ImageSize{320, 400}});
  EXPECT_EQ(smaller.image_size, (ImageSize{320, 400}));
  ExpectView(smaller, {250, 250, 159.5 - 19.5 / 2, 199.5 + 20.5 / 2});
}

TEST(PinholeView, HasTheFieldOfViewAskedFor) {
  ExpectView(ChoosePinhole(std::vector{Fisheye(300)}, {.fov = 90}), {320, 320, 319.5, 239.5});
  const double f = 400 / std::tan(60 * kDegree);
  ExpectView(ChoosePinhole(std::vector{Fisheye(300)}, {.size = ImageSize{800, 200}, .fov = 120}),
             {f, f, 399.5, 99.5});
}

TEST(PinholeView, IsBalancedBetweenAllValidAndAllSeen) {
  constexpr double kF = 300;
  const std::vector images{Fisheye(kF)};
  // At angle r / f from the axis the plane is f_view tan(r / f) from the middle. The last pixels
  // with a source are above the middle, 240 px from it; the last pixels seen are the corners.
  const double valid = 240 / std::tan(240 / kF), seen = 400 / std::tan(400 / kF);
  for (const double balance : {0.0, 0.3, 1.0}) {
    const double f = 1 / ((1 - balance) / valid + balance / seen);
    ExpectView(ChoosePinhole(images, {.balance = balance}), {f, f, 319.5, 239.5});
  }
  // All of a pinhole camera's pixels have a source, whatever its principal point.
  for (const double balance : {0.0, 1.0}) {
    ExpectView(ChoosePinhole(std::vector{Pinhole(500, {319.5, 239.5})}, {.balance = balance}),
               {500, 500, 319.5, 239.5});
  }
}

TEST(PinholeView, OfMoreThan180DegreesHasNoWholeImage) {
  const std::vector images{Fisheye(200)};  // 115 degrees off the axis in the corners
  EXPECT_THROW(ChoosePinhole(images, {.balance = 1}), Error);
  EXPECT_THROW(ChoosePinhole(images, {.balance = 0.1}), Error);
  const double valid = 240 / std::tan(240 / 200.0);
  ExpectView(ChoosePinhole(images, {.balance = 0}), {valid, valid, 319.5, 239.5});
}

TEST(PinholeView, OfSeveralCamerasIsInTheMiddleOfThem) {
  SeenImage left = Pinhole(500, {319.5, 239.5}), right = Pinhole(600, {319.5, 239.5});
  left.R_view_camera = Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitY()).toRotationMatrix();
  right.R_view_camera = Eigen::AngleAxisd(-0.3, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const double middle = (std::tan(0.1) - std::tan(0.3)) / 2;
  ExpectView(ChoosePinhole(std::vector{left, right}, {}), {550, 550, 319.5 - 550 * middle, 239.5});
  // One camera that is turned has its middle in the middle.
  ExpectView(ChoosePinhole(std::vector{left}, {}), {500, 500, 319.5 - 500 * std::tan(0.1), 239.5});
}

TEST(PinholeView, RefusesACameraThatLooksAway) {
  SeenImage away = Pinhole(500, {319.5, 239.5});
  away.R_view_camera = Eigen::AngleAxisd(2, Eigen::Vector3d::UnitX()).toRotationMatrix();
  EXPECT_THROW(ChoosePinhole(std::vector{away}, {.balance = 0}), Error);
}

TEST(PinholeView, RefusesOptionsOutOfRange) {
  const std::vector images{Fisheye(300)};
  EXPECT_THROW(ChoosePinhole(images, {.fov = 176}), Error);
  EXPECT_THROW(ChoosePinhole(images, {.fov = 0.5}), Error);
  EXPECT_THROW(ChoosePinhole(images, {.balance = -0.1}), Error);
  EXPECT_THROW(ChoosePinhole(images, {.balance = 1.1}), Error);
}

TEST(PinholeView, RefusesFocalLengthsThatNoCameraHas) {
  for (const double f : {0.0, std::numeric_limits<double>::infinity()}) {
    EXPECT_THROW(ChoosePinhole(std::vector{Pinhole(f, {319.5, 239.5})}, {}), Error) << f;
  }
}

TEST(PinholeView, HasNameAndPoseOfItsCamera) {
  CalibratedCamera camera;
  camera.name = "left";
  camera.model = FindModel(CameraModels(), "pinhole-radial3");
  camera.image_size = {640, 480};
  camera.params.assign(camera.model->params.size(), 0);
  const std::array start{480.0, 490.0, 310.0, 250.0};
  std::ranges::copy(start, camera.params.begin());
  camera.T_camera_rig.t = {0.1, 0.2, 0.3};
  const CalibratedCamera view = UndistortedView(camera, {});
  EXPECT_EQ(view.name, "left");
  EXPECT_EQ(view.T_camera_rig.t, camera.T_camera_rig.t);
  ExpectView(view, start);
  EXPECT_EQ(view.image_size, camera.image_size);
}

}  // namespace TEST_FILE
}  // namespace plenocal
