// SPDX-License-Identifier: Apache-2.0
//
// Tags that lie in the scene of a session without a target.
#include <Eigen/Geometry>
#include <array>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;

constexpr int kTags = 9;
constexpr double kSize = 0.08;  // m

// Tags in space, each turned by itself.
std::array<Eigen::Vector3d, 4> CornersOf(int id) {
  const int column = id % 3, row = id / 3;
  const Eigen::Vector3d centre(0.2 * column - 0.2, 0.2 * row - 0.2, 0.1 * ((4 * id) % 5) - 0.2);
  const Eigen::Matrix3d R =
      Eigen::AngleAxisd(0.4, Eigen::Vector3d(id % 2 - 0.5, id % 3 - 1.0, 0.3).normalized())
          .toRotationMatrix();
  std::array<Eigen::Vector3d, 4> corners;
  const std::array<Eigen::Vector3d, 4> square{
      {{-0.5, -0.5, 0}, {0.5, -0.5, 0}, {0.5, 0.5, 0}, {-0.5, 0.5, 0}}};
  for (size_t k = 0; k < 4; ++k) corners[k] = centre + R * (kSize * square[k]);
  return corners;
}

Eigen::Vector3d CentreOf(int id) {
  const auto corners = CornersOf(id);
  return (corners[0] + corners[1] + corners[2] + corners[3]) / 4;
}

class SceneTags : public Workspace {
 protected:
  // Images of a pair whose baseline is 0.1 m.
  void Simulate() {
    std::string target = "plenocal: 1\ntype: apriltag\nfamily: tag36h11\ntags:\n";
    for (int id = 0; id < kTags; ++id) {
      target += fmt::format("  - {{id: {}, corners: [", id);
      for (const Eigen::Vector3d& p : CornersOf(id)) {
        target += fmt::format("[{:.9f}, {:.9f}, {:.9f}], ", p.x(), p.y(), p.z());
      }
      target += "]}\n";
    }
    Write("target.yaml", target);
    const std::string camera =
        "{model: pinhole-radial3, image_size: [480, 400], parameters: {f_x: 310, f_y: 311, c_x: 236, "
        "c_y: 203, A_0: -0.2, A_1: 0.06, A_2: -0.01}, blur: 0.6";
    Write("spec.yaml",
          "plenocal: 1\nseed: 4\ntarget: target.yaml\n"
          "poses: {frames: 8, distance: [0.7, 1.2], tilt: 0.6}\ncameras:\n  left: " +
              camera + "}\n  right: " + camera +
              ", xi_camera_rig: [-0.1, 0.001, -0.002, 0.005, -0.02, 0.01]}\n");
    const Outcome outcome = Run({"simulate", "spec.yaml", "-o", "set"});
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
  }

  Outcome Calibrate(const std::string& scene) {
    Write("session.yaml",
          "plenocal: 1\nscene: {points: 20, " + scene +
              "}\ncameras:\n  left: {model: pinhole-radial3, images: set/left}\n"
              "  right: {model: pinhole-radial3, images: set/right}\n");
    return Run({"calibrate", "session.yaml", "--no-report", "-o", "out"});
  }

  struct Baseline {
    double length, sigma;
  };
  [[nodiscard]] Baseline BaselineOfResult() const {
    const YAML::Node camera = YAML::Load(Read("out/calibration.yaml"))["cameras"]["right"];
    const auto xi = camera["xi_camera_rig"].as<std::vector<double>>();
    return {Eigen::Vector3d(xi[0], xi[1], xi[2]).norm(),
            camera["sigma_xi"].as<std::vector<double>>()[0]};
  }
};

TEST_F(SceneTags, GiveTheScaleByTheirSizeOrTheDistanceOfTheirCentres) {
  Simulate();
  const std::string ids = "family: tag36h11, ids: [0, 1, 2, 3, 4, 5, 6, 7, 8, 30]";
  const Eigen::Vector3d offset(0.1, -0.001, 0.002);

  // Printed at a scale that is known to 0.5 %: averaging over tags does not make it better.
  Outcome outcome = Calibrate("tags: {" + ids + ", size: 80 mm, size_sigma: 0.4 mm}");
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("9 of 10 tags found"));
  EXPECT_THAT(outcome.err, HasSubstr("tag 30: no image of an ordinary camera shows it"));
  EXPECT_NEAR(BaselineOfResult().length, offset.norm(), 1e-4);
  EXPECT_NEAR(BaselineOfResult().sigma, 0.005 * 0.1, 0.02 * 0.005 * 0.1);
  const YAML::Node left = YAML::Load(Read("out/calibration.yaml"))["cameras"]["left"];
  EXPECT_NEAR(left["parameters"]["f_x"].as<double>(), 310, 5 * left["sigma"]["f_x"].as<double>());
  EXPECT_LT(left["sigma"]["f_x"].as<double>(), 0.1);

  const double length = (CentreOf(0) - CentreOf(8)).norm();
  outcome = Calibrate(fmt::format(
      "tags: {{{}}}, distances: [{{between: [tag 0, tag 8], length: {}, sigma: 0.2 mm}}]",
      ids,
      length));
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_NEAR(BaselineOfResult().length, offset.norm(), 1e-4);
  EXPECT_NEAR(BaselineOfResult().sigma, 0.1 * 2e-4 / length, 0.3 * 0.1 * 2e-4 / length);
}

TEST_F(SceneTags, RefuseWhatNamesNoTag) {
  const auto expect = [&](const std::string& scene, const std::string& part) {
    const Outcome outcome = Calibrate(scene);
    EXPECT_EQ(outcome.status, kWrongInput) << scene;
    EXPECT_THAT(outcome.err, HasSubstr("session.yaml"));
    EXPECT_THAT(outcome.err, HasSubstr(part));
  };
  expect("tags: {family: tag36h11}", "scene.tags.ids");
  expect("tags: {family: tag36h11, ids: [3, 3]}", "stands twice");
  expect("tags: {family: tag36h11, ids: [-1]}", "no tag has this id");
  expect("tags: {family: tag36h11, ids: [1], size: 80 mm}", "belong together");
  expect("distances: [{between: [tag 3, tag 7 corner 4], length: 1, sigma: 0.01}]",
         "'tag ID corner 0' to 3");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
