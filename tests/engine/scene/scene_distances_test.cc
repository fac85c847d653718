// SPDX-License-Identifier: Apache-2.0
//
// Distances and tags of a scene that few frames show: which give the scale, and what is left out.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

#include "engine/scene/scene_calibration.h"
#include "models/registry.h"
#include "tests/calib/random.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;

constexpr double kFocal = 600;  // px
constexpr int kPoints = 30;

// The last four are the corners of tag 3, a square of 0.5 m.
Eigen::Vector3d PointAt(int k) {
  static const std::vector<Eigen::Vector3d> points = [] {
    Random random(4);
    std::vector<Eigen::Vector3d> made;
    for (int i = 0; i < kPoints; ++i) made.push_back(random.Uniforms<3>(-1, 1));
    made.insert(made.end(), {{0, 0, 0.3}, {0.5, 0, 0.3}, {0.5, 0.5, 0.3}, {0, 0.5, 0.3}});
    return made;
  }();
  return points[static_cast<size_t>(k)];
}

int NumberOf(int k) { return k < kPoints ? k : TagPoint(3, k - kPoints); }

// A camera of known parameters; point 99 is seen once, 98 in places that contradict each other.
SceneCalibrationInput Input(int frames = 4) {
  Random random(5);
  CameraInput camera{.name = "left",
                     .model = FindModel(CameraModels(), "pinhole"),
                     .config = {},
                     .initial = {kFocal, kFocal, 320, 240},
                     .fixed = std::vector<bool>(4, true),
                     .image_size = {640, 480},
                     .views = {}};
  for (int frame = 0; frame < frames; ++frame) {
    const double angle = 0.2 * frame;
    const RigidTransform T{ExpRotation({0.3 * std::sin(3 * angle), angle, 0.2 * angle}), {0, 0, 4}};
    View& view = camera.views.emplace_back();
    view.frame = std::to_string(100 + frame);
    const auto add = [&](int number, double x, double y) {
      Observation& seen = view.observations.emplace_back();
      seen.marker = number;
      seen.values[0] = x + random.Gaussian(0.1);
      seen.values[1] = y + random.Gaussian(0.1);
      seen.detector_sigma = 0.1;
    };
    for (int k = 0; k < kPoints + 4; ++k) {
      const Eigen::Vector3d p = T * PointAt(k);
      add(NumberOf(k), 320 + kFocal * p.x() / p.z(), 240 + kFocal * p.y() / p.z());
    }
    add(98, frame % 2 == 0 ? 100 : 500, frame % 2 == 0 ? 50 : 400);
    if (frame == 0) add(99, 300, 200);
  }
  return {.cameras = {.inputs = {camera},
                      .T_camera_rig = {std::nullopt},
                      .fixed_extrinsics = {false},
                      .prior = {},
                      .without_sigmas = {false}},
          .distances = {}};
}

const YamlNode& Node() {
  static const YamlNode node = YamlNode::Parse("a: 1", "session.yaml");
  return node;
}

SceneDistance Between(int a, int b, double length) {
  return {.a = {"point " + std::to_string(a), {a}},
          .b = {"point " + std::to_string(b), {b}},
          .length = length,
          .sigma = 1e-3,
          .common_sigma = 2e-3,
          .place = Node().At("a")};
}

double Apart(const Calibration& calibration, int a, int b) {
  const auto position = [&](int number) {
    return std::ranges::find(calibration.bundle.markers, number, &BundleMarker::number)->position;
  };
  return (position(a) - position(b)).norm();
}

std::vector<std::string> CodesOf(const Calibration& calibration) {
  std::vector<std::string> codes;
  for (const Finding& each : calibration.findings) codes.push_back(each.code);
  return codes;
}

TEST(SceneDistances, OfPointsWithPositionsGiveTheScale) {
  SceneCalibrationInput input = Input();
  constexpr double kScale = 3;
  input.distances = {Between(98, 7, 1),
                     Between(2, 98, 1),
                     Between(3, 20, kScale * (PointAt(3) - PointAt(20)).norm())};
  input.from_images = true;
  std::vector<std::string> stages;
  const Calibration found = CalibrateScene(input, {.progress = [&](const std::string& stage) {
                                             stages.push_back(stage);
                                             return true;
                                           }});
  EXPECT_EQ(stages.front(), "initial guess");
  EXPECT_EQ(stages.back(), "bundle adjustment");
  ASSERT_EQ(found.left_out.size(), 2U);
  EXPECT_EQ(found.left_out[0].where, "distance of point 98 and point 7");
  EXPECT_EQ(found.left_out[0].reason, "no two views that agree show point 98");
  EXPECT_EQ(found.left_out[1].where, "distance of point 2 and point 98");
  EXPECT_EQ(found.left_out[1].reason, "no two views that agree show point 98");
  ASSERT_EQ(found.bundle.distances.size(), 1U);
  EXPECT_EQ(found.bundle.distances[0].sigma, 1e-3);
  EXPECT_EQ(found.bundle.distances[0].common_sigma, 2e-3);
  EXPECT_NEAR(Apart(found, 5, 9), kScale * (PointAt(5) - PointAt(9)).norm(), 0.05);
  EXPECT_FALSE(found.bundle.scale_distance);
  EXPECT_EQ(found.bundle.fixed_frame, 0U);
  EXPECT_THAT(found.frames, ElementsAre("100", "101", "102", "103"));
  EXPECT_EQ(CodesOf(found).back(), "scene_patches");
  ASSERT_EQ(found.fits.size(), 1U);
  EXPECT_GT(found.fits[0].points, 100);
  EXPECT_EQ(found.fits[0].detector_sigma, 0.1);
  EXPECT_TRUE(found.converged);
  EXPECT_LE(found.iterations, 5);  // the start has the scale
}

TEST(SceneDistances, OfTagsAreTheirSidesAndDiagonals) {
  SceneCalibrationInput input = Input();
  input.tags = SceneTags{.ids = {3, 5}, .size = 1, .size_sigma = 1e-3, .node = Node()};
  const Calibration found = CalibrateScene(input, {});
  EXPECT_EQ(found.bundle.distances.size(), 6U);
  EXPECT_LE(found.iterations, 5);
  EXPECT_NEAR(Apart(found, TagPoint(3, 0), TagPoint(3, 1)), 1, 0.01);
  EXPECT_NEAR(Apart(found, 5, 9), 2 * (PointAt(5) - PointAt(9)).norm(), 0.05);
  ASSERT_EQ(found.left_out.size(), 1U);
  EXPECT_EQ(found.left_out[0].where, "tag 5");
  EXPECT_EQ(found.left_out[0].reason, "not all of its corners have tracks");
  EXPECT_EQ(found.left_out[0].marker, "5");
  EXPECT_THAT(CodesOf(found), ::testing::Not(::testing::Contains("scene_no_scale")));
}

TEST(SceneDistances, OfPointsWithoutAPositionAreRefused) {
  const auto refused = [](const SceneDistance& distance) {
    SceneCalibrationInput input = Input();
    input.distances = {distance};
    return Refusal([&] { CalibrateScene(input, {}); });
  };
  const std::string why =
      " has no position: no two views that agree show it; name another point, or remove this "
      "distance";
  EXPECT_EQ(refused(Between(5, 77, 1)), "input: session.yaml:1:4: a: point 77" + why);
  EXPECT_EQ(refused(Between(98, 5, 1)), "input: session.yaml:1:4: a: point 98" + why);
  // A number that no view has is a slip, also beside others.
  for (const SceneDistance& slip : {Between(77, 5, 1), Between(5, 77, 1)}) {
    SceneCalibrationInput input = Input(3);
    input.distances = {Between(3, 20, 1), slip};
    EXPECT_EQ(Refusal([&] { CalibrateScene(input, {}); }),
              "input: session.yaml:1:4: a: point 77" + why);
  }
}

TEST(SceneDistances, NeedThreeFramesAndObservations) {
  SceneCalibrationInput three = Input(3);
  three.cameras.inputs[0].views[2].observations.resize(7);
  EXPECT_EQ(
      Refusal([&] { CalibrateScene(three, {}); }),
      "job: left: poses for 2 of 3 frames only; record frames that overlap more, or give better "
      "start values ('initial', 'from')");
  SceneCalibrationInput input = Input();
  input.cameras.inputs[0].views.clear();
  EXPECT_EQ(Refusal([&] { CalibrateScene(input, {}); }), "input: left: has no observations");
  for (const std::string last : {"initial guess", "bundle adjustment"}) {
    std::string stage;
    const auto go_on = [&](const std::string& entered) {
      stage = entered;
      return entered != last;
    };
    EXPECT_THROW(CalibrateScene(Input(), {.progress = go_on}), Stopped);
    EXPECT_EQ(stage, last);
  }
}

// An earlier calibration holds a focal length.
TEST(SceneDistances, LeaveThePriorsOfParameters) {
  SceneCalibrationInput input = Input();
  input.cameras.inputs[0].fixed[0] = false;
  CalibrationPrior prior;
  prior.unknowns = {{.camera = 0, .param = 0, .value = kFocal + 5}};
  prior.T_camera_rig = {{}};
  prior.weight = Eigen::MatrixXd::Constant(1, 1, 1e3);
  input.cameras.prior = prior;
  const Calibration found = CalibrateScene(input, {});
  EXPECT_NEAR(found.bundle.cameras[0].params[0], kFocal + 5, 0.1);
  EXPECT_NEAR(found.uncertainty.param_std_errors[0][0], 1e-3, 1e-4);
}

TEST(SceneDistances, FramesOfTooFewPointsAreLeftOut) {
  SceneCalibrationInput input = Input(5);
  input.cameras.inputs[0].views[2].observations.resize(7);  // of eight
  const Calibration found = CalibrateScene(input, {});
  EXPECT_THAT(found.frames, ElementsAre("100", "101", "103", "104"));
  ASSERT_FALSE(found.left_out.empty());
  EXPECT_EQ(found.left_out[0].where, "frame 102");
  EXPECT_EQ(found.left_out[0].reason, "too few of its points agree with other frames");
  EXPECT_EQ(found.left_out[0].frame, "102");
  EXPECT_TRUE(found.left_out[0].whole);
  EXPECT_EQ(found.bundle.T_rig_target.size(), 4U);
  EXPECT_EQ(found.bundle.observations.size(), 4U * (kPoints + 4));
  EXPECT_TRUE(found.bundle.scale_distance);
  EXPECT_EQ(CodesOf(found).front(), "scene_no_scale");
  // Shapes are right but for the scale.
  const double scale = Apart(found, 5, 9) / (PointAt(5) - PointAt(9)).norm();
  EXPECT_NEAR(Apart(found, 1, 20), scale * (PointAt(1) - PointAt(20)).norm(), 0.02 * scale);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
