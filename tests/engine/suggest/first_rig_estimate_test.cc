// SPDX-License-Identifier: Apache-2.0
#include "engine/suggest/first_rig_estimate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <tuple>

#include "models/registry.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

constexpr double kDegree = std::numbers::pi / 180;
constexpr ImageSize kSize{800, 600};

FirstCamera Camera(const char* model, double angle_deg) {
  return {.name = "cam",
          .model = FindModel(CameraModels(), model),
          .image_size = kSize,
          .angle = angle_deg * kDegree};
}

// A board of 7 x 5 points, 40 mm apart.
std::map<int, Eigen::Vector3d> Board() {
  std::map<int, Eigen::Vector3d> markers;
  for (int i = 0; i < 35; ++i) markers[100 + i] = {0.04 * (i % 7), 0.04 * (i / 7), 0};
  return markers;
}

// Distance from the image's middle at which the first estimate images a ray, px.
double Radius(const FirstCamera& camera, double angle) {
  const RigEstimate rig = MakeFirstRigEstimate({camera}, Board(), MarkerFreedom::Rigid());
  const BundleCamera& made = rig.bundle.cameras[0];
  // Along x, and along y with the other focal length.
  double radii[2];
  for (int axis = 0; axis < 2; ++axis) {
    Eigen::Vector3d p(0, 0, std::cos(angle));
    p[axis] = std::sin(angle);
    double u[kMaxObservationSize];
    EXPECT_TRUE(made.model->Project(made.params.data(), nullptr, nullptr, p, u));
    EXPECT_NEAR(u[1 - axis], (kSize[static_cast<size_t>(1 - axis)] - 1) / 2.0, 0.05);
    radii[axis] = u[axis] - (kSize[static_cast<size_t>(axis)] - 1) / 2.0;
  }
  EXPECT_NEAR(radii[0], radii[1], 0.05);
  return radii[0];
}

TEST(FirstRigEstimate, IsAPinholeWhoseHalfWidthIsHalfTheAngle) {
  for (const char* model : {"pinhole", "pinhole-radtan4", "eucm", "kannala-brandt4"}) {
    const double f = kSize[0] / 2.0 / std::tan(30 * kDegree);
    EXPECT_NEAR(Radius(Camera(model, 60), 0.3), f * std::tan(0.3), 0.3) << model;
  }
}

TEST(FirstRigEstimate, HasRadiiInProportionToTheAngleBeyond100Degrees) {
  const double of_angle = kSize[0] / 2.0 / (75 * kDegree);
  EXPECT_NEAR(Radius(Camera("kannala-brandt4", 150), 1), of_angle, 0.3);
}

std::string Refusal(const FirstCamera& camera) {
  return testing::RefusalOf(
      [&] { MakeFirstRigEstimate({camera}, Board(), MarkerFreedom::Rigid()); });
}

TEST(FirstRigEstimate, IsRefusedWhereAnAngleDoesNotDescribeTheLens) {
  using ::testing::HasSubstr;
  EXPECT_THAT(Refusal(Camera("focused-plenoptic", 20)), HasSubstr("needs more than a lens angle"));
  EXPECT_THAT(Refusal(Camera("splined", 60)), HasSubstr("needs more than a lens angle"));
  EXPECT_THAT(Refusal(Camera("pinhole", 190)),
              HasSubstr("cam: the model pinhole does not describe a lens of 190 degrees"));
}

// Images of the board at known poses by the pinhole camera of 60 degrees.
View ViewOfBoard(const std::string& frame, const RigidTransform& T_camera_target) {
  View view{.frame = frame, .observations = {}};
  const double f = kSize[0] / 2.0 / std::tan(30 * kDegree);
  for (const auto& [number, position] : Board()) {
    const Eigen::Vector3d p = T_camera_target * position;
    view.observations.push_back({.marker = number,
                                 .values = {(kSize[0] - 1) / 2.0 + f * p.x() / p.z(),
                                            (kSize[1] - 1) / 2.0 + f * p.y() / p.z()}});
  }
  return view;
}

TEST(FirstRigEstimate, HasThePosesOfTheImagesSoFar) {
  const RigidTransform near{ExpRotation({0.3, 0.1, 0}), {-0.1, -0.1, 0.6}};
  const RigidTransform far{ExpRotation({-0.2, 0.3, 0.1}), {-0.05, -0.1, 1}};
  FirstCamera left = Camera("pinhole", 60), right = left;
  right.name = "right";
  left.views = {ViewOfBoard("b", far), ViewOfBoard("c", near)};
  left.views[1].observations.resize(3);  // from which no pose follows
  left.views[0].observations[2].detector_sigma = 0.03;
  left.views[0].observations[5].marker = 9;  // the target has no such point
  right.views = {ViewOfBoard("a", near), ViewOfBoard("b", far)};
  const RigEstimate rig =
      MakeFirstRigEstimate({left, right}, Board(), MarkerFreedom::FromSigma(2e-4));
  const Bundle& bundle = rig.bundle;
  EXPECT_EQ(bundle.marker_freedom.Sigma(), 2e-4);
  // Frames in the order of their first camera: b, a.
  ASSERT_EQ(bundle.T_rig_target.size(), 2U);
  EXPECT_LT((bundle.T_rig_target[0].t - far.t).norm(), 1e-5);
  EXPECT_LT((bundle.T_rig_target[1].t - near.t).norm(), 1e-5);
  EXPECT_TRUE(bundle.cameras[0].is_master);
  EXPECT_FALSE(bundle.cameras[1].is_master);
  EXPECT_TRUE(bundle.cameras[1].T_camera_rig.t.isZero(0));
  ASSERT_EQ(bundle.observations.size(), 34U + 35U + 35U);
  EXPECT_TRUE(std::ranges::is_sorted(bundle.observations, {}, [](const auto& each) {
    return std::tuple(each.frame, each.camera, each.marker);
  }));
  for (const BundleObservation& each : bundle.observations) {
    EXPECT_EQ(bundle.markers[static_cast<size_t>(each.marker)].number, each.seen.marker);
    EXPECT_EQ(each.assumed_sigma, each.seen.detector_sigma > 0 ? 0.03 : 0.1);
  }
  EXPECT_EQ(rig.sigma_px, (std::vector<double>{0.1, 0.1}));
  EXPECT_EQ(rig.factors, (std::vector<double>{1, 1}));
  EXPECT_EQ(rig.lenses.size(), 2U);
}

}  // namespace TEST_FILE
}  // namespace plenocal
