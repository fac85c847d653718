// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/extrinsics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <string>

#include "calib/camera/rigid_transform.h"

namespace plenocal {
namespace TEST_FILE {

// Of a camera 0.3 m to the right of the master, turned about y by 10 degrees.
CalibratedCamera TurnedCamera() {
  CalibratedCamera camera;
  camera.name = "right";
  Vector6d turn = Vector6d::Zero();
  turn[4] = 10 * M_PI / 180;
  RigidTransform T_rig_camera = Exp(turn);
  T_rig_camera.t = {0.3, 0, 0.04};
  camera.T_camera_rig = T_rig_camera.Inverse();
  camera.sigma_xi << 1e-4, 2e-4, 3e-4, 1e-4, 2e-4, 3e-4;
  return camera;
}

std::map<std::string, Extrinsic> ByName(const CalibratedCamera& camera) {
  static const CameraModel kModel{};
  CalibratedCamera with_model = camera;
  with_model.model = &kModel;
  std::map<std::string, Extrinsic> named;
  for (const Extrinsic& each : ExtrinsicsOf(with_model, {})) named.emplace(each.name, each);
  return named;
}

TEST(ExtrinsicsOf, AreMillimetresAndDegrees) {
  const auto named = ByName(TurnedCamera());
  EXPECT_NEAR(named.at("x").value, 300, 1e-9);
  EXPECT_NEAR(named.at("z").value, 40, 1e-9);
  EXPECT_NEAR(named.at("baseline").value, std::hypot(300, 40), 1e-9);
  EXPECT_NEAR(named.at("angle").value, 10, 1e-9);
  EXPECT_NEAR(named.at("rotation about y").value, 10, 1e-9);
  EXPECT_TRUE(ByName(CalibratedCamera()).empty());
}

TEST(ExtrinsicsOf, ScatterByTheirStandardErrors) {
  const CalibratedCamera camera = TurnedCamera();
  const auto named = ByName(camera);
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  std::map<std::string, double> squares;
  constexpr int kDraws = 4000;
  for (int i = 0; i < kDraws; ++i) {
    Vector6d xi = Log(camera.T_camera_rig);
    for (Eigen::Index k = 0; k < 6; ++k) xi[k] += camera.sigma_xi[k] * normal(random);
    CalibratedCamera drawn = camera;
    drawn.T_camera_rig = Exp(xi);
    for (const auto& [name, each] : ByName(drawn)) {
      squares[name] += std::pow(each.value - named.at(name).value, 2) / kDraws;
    }
  }
  for (const auto& [name, square] : squares) {
    EXPECT_NEAR(std::sqrt(square) / named.at(name).sigma, 1, 0.05) << name;
  }
}

TEST(ExtrinsicsOf, AreOpenWhereThePoseIs) {
  CalibratedCamera camera = TurnedCamera();
  camera.sigma_xi[0] = std::numeric_limits<double>::infinity();
  for (const auto& [name, each] : ByName(camera)) EXPECT_TRUE(std::isinf(each.sigma)) << name;
}

}  // namespace TEST_FILE
}  // namespace plenocal
