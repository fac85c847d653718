// SPDX-License-Identifier: Apache-2.0
//
// Defects of scenes and paths at their limits, of bundles that are put together by hand.
#include "engine/scene/scene_findings.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <limits>
#include <numbers>

#include "engine/scene/scene_calibration.h"
#include "models/registry.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kDegree = std::numbers::pi / 180;

BundleCamera Pinhole(const std::string& name) {
  BundleCamera camera{.name = name,
                      .image_size = {640, 480},
                      .model = FindModel(CameraModels(), "pinhole"),
                      .config = {},
                      .params = {500, 400, 320, 240},
                      .fixed = std::vector<bool>(4, false),
                      .T_camera_rig = {}};
  camera.is_master = true;
  return camera;
}

// f_L, b_L0, B, c_x, c_y, no distortion.
BundleCamera Plenoptic(const std::string& name) {
  BundleCamera camera{.name = name,
                      .image_size = {1000, 1000},
                      .model = FindModel(CameraModels(), "focused-plenoptic"),
                      .config = {5e-6},
                      .params = {0.016, 0.0155, 0.0005, 500, 500, 0, 0, 0, 0},
                      .fixed = std::vector<bool>(9, false),
                      .T_camera_rig = {}};
  camera.is_master = true;
  return camera;
}

// Two frames, the second one turned by `turn` degrees and with its centre `motion` m away, and
// points at these depths in the first one. Each camera sees all points in both frames.
Calibration Seen(const std::vector<BundleCamera>& cameras,
                 double turn,
                 double motion,
                 const std::vector<double>& depths) {
  Calibration calibration;
  Bundle& bundle = calibration.bundle;
  bundle.cameras = cameras;
  const Eigen::Matrix3d R = ExpRotation({0, 0, turn * kDegree});
  bundle.T_rig_target = {{}, {R, -(R * Eigen::Vector3d(0, motion, 0))}};
  for (size_t m = 0; m < depths.size(); ++m) {
    bundle.markers.push_back({.number = static_cast<int>(m),
                              .position = {0.01, 0.02, depths[m]},
                              .nominal = Eigen::Vector3d::Zero()});
  }
  for (int frame = 0; frame < 2; ++frame) {
    for (int c = 0; c < static_cast<int>(cameras.size()); ++c) {
      for (int m = 0; m < static_cast<int>(depths.size()); ++m) {
        BundleObservation& seen = bundle.observations.emplace_back(
            BundleObservation{.camera = c, .frame = frame, .marker = m, .seen = {}});
        seen.seen.values = {500, 500, 520, 510};
      }
    }
  }
  for (const BundleCamera& camera : cameras) {
    calibration.uncertainty.param_std_errors.emplace_back(camera.params.size(), 1e-9);
  }
  return calibration;
}

std::vector<std::string> Codes(const Calibration& calibration) {
  std::vector<std::string> codes;
  for (const Finding& each : FindingsOfScene(calibration)) codes.push_back(each.code);
  return codes;
}

TEST(SceneFindings, AGoodSceneHasNone) {
  EXPECT_THAT(Codes(Seen({Pinhole("left")}, 20, 1, {1, 2, 3})), IsEmpty());
}

TEST(SceneFindings, PointsOfOneDepthAreNamedBelowARatioOf1Point3) {
  EXPECT_THAT(Codes(Seen({Pinhole("left")}, 20, 1, {2, 2.2, 2.602})), IsEmpty());
  EXPECT_THAT(Codes(Seen({Pinhole("left")}, 20, 1, {0.2, 0.22})), ElementsAre("scene_one_depth"));
  EXPECT_THAT(Codes(Seen({Pinhole("left")}, 20, 1, {-0.2, 0.22})), IsEmpty());
  Calibration calibration = Seen({Pinhole("left")}, 20, 1, {2, 2.2, 2.598});
  const auto with_focal = [&](double sigma_x, double sigma_y) {
    calibration.uncertainty.param_std_errors[0] = {sigma_x, sigma_y, 100, 100};
    const std::vector<Finding> found = FindingsOfScene(calibration);
    EXPECT_EQ(found.size(), 1U);
    EXPECT_EQ(found[0].code, "scene_one_depth");
    EXPECT_EQ(found[0].role, FindingRole::kCause);
    EXPECT_THAT(found[0].cameras, ElementsAre("left"));
    EXPECT_NEAR(found[0].value.value(), 1.299, 1e-9);
    EXPECT_EQ(found[0].limit, 1.3);
    return found[0];
  };
  // The worse one of f_x = 500 and f_y = 400 px decides: poor above 1e-3, bad above a tenth.
  struct Case {
    double x, y;
    Grade grade;
    std::string what;
  };
  for (const Case& each : {Case{0.49, 0.1, Grade::kGood, "f_x known to 0.098 %"},
                           Case{0.1, 0.41, Grade::kUsable, "f_y known to 0.1 %"},
                           Case{49, 0, Grade::kUsable, "f_x known to 9.8 %"},
                           Case{51, 1, Grade::kBad, "f_x known to 10 %"},
                           Case{1, kInfinite, Grade::kBad, "f_y is open"}}) {
    const Finding found = with_focal(each.x, each.y);
    EXPECT_EQ(found.grade, each.grade);
    EXPECT_EQ(found.what, "left: all points are between 2 and 2.6 m: " + each.what + ".");
  }
  // Fixed focal lengths have no error.
  calibration.bundle.cameras[0].fixed = {true, false, false, false};
  EXPECT_EQ(with_focal(kInfinite, 0.1).grade, Grade::kGood);
}

// Two percent of the points at either end are no depth of the scene.
TEST(SceneFindings, DepthsLeaveOutFewPoints) {
  for (const double outside : {1.0, 9.0}) {
    for (const size_t count : {1U, 6U}) {
      std::vector<double> depths(200, 2);
      for (size_t k = 0; k < count; ++k) depths[k] = outside;
      EXPECT_EQ(Codes(Seen({Pinhole("left")}, 20, 1, depths)).size(), count == 1 ? 1U : 0U);
    }
  }
}

TEST(SceneFindings, OnlyUsedObservationsOfTheCameraHaveDepths) {
  Calibration calibration = Seen({Pinhole("left"), Pinhole("right")}, 20, 1, {2, 2.1, 5});
  for (BundleObservation& seen : calibration.bundle.observations) {
    if (seen.camera == 1 && seen.marker == 2) seen.used = false;
  }
  const std::vector<Finding> found = FindingsOfScene(calibration);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_THAT(found[0].cameras, ElementsAre("right"));
}

TEST(SceneFindings, DepthsAreThoseBeforeTheCamera) {
  BundleCamera right = Pinhole("right");
  right.T_camera_rig.t.z() = 8;  // depths 10 and 13 in place of 2 and 5
  const std::vector<Finding> found =
      FindingsOfScene(Seen({Pinhole("left"), right}, 20, 1, {2, 4.9}));
  ASSERT_EQ(found.size(), 1U);
  EXPECT_NEAR(found[0].value.value(), 1.29, 1e-9);
}

TEST(SceneFindings, APathHasToTurnBy12Degrees) {
  EXPECT_THAT(Codes(Seen({Pinhole("left")}, 12.01, 1, {1, 2, 3})), IsEmpty());
  const std::vector<Finding> found = FindingsOfScene(Seen({Pinhole("left")}, 11.94, 1, {1, 2, 3}));
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].code, "scene_no_turning");
  EXPECT_NEAR(found[0].value.value(), 11.94, 1e-9);
  EXPECT_EQ(found[0].limit, 12);
  EXPECT_EQ(found[0].grade, Grade::kGood);
  EXPECT_EQ(found[0].what,
            "left: the camera never turned (by at most 11.9 degrees): f_y known to 2.5e-10 %.");
  // In any frame of the scene.
  Calibration turned = Seen({Pinhole("left")}, 11.94, 1, {1, 2, 3});
  const Eigen::Matrix3d R = ExpRotation({0.4, -0.7, 1.1});
  for (RigidTransform& T : turned.bundle.T_rig_target) T.R = (T.R * R.transpose()).eval();
  for (BundleMarker& marker : turned.bundle.markers) marker.position = (R * marker.position).eval();
  EXPECT_NEAR(FindingsOfScene(turned).at(0).value.value(), 11.94, 1e-9);
}

TEST(SceneFindings, APathHasToMoveByAFiftiethOfTheDistance) {
  EXPECT_THAT(Codes(Seen({Pinhole("left")}, 20, 0.0401, {1, 2, 3})), IsEmpty());
  Calibration calibration = Seen({Pinhole("left")}, 20, 0.0399, {1, 2, 3});
  calibration.uncertainty.param_std_errors[0][0] = 60;
  const std::vector<Finding> found = FindingsOfScene(calibration);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].code, "scene_no_parallax");
  EXPECT_NEAR(found[0].value.value(), 0.0399 / 2, 1e-9);
  EXPECT_EQ(found[0].limit, 0.02);
  EXPECT_EQ(found[0].grade, Grade::kBad);
  EXPECT_EQ(found[0].what,
            "left: the camera hardly moved (0.04 m at points 2 m away): f_x known to 12 %.");
}

// The two frames that are farthest apart need not be the first ones.
TEST(SceneFindings, APathExtendsBetweenAnyTwoFrames) {
  Calibration calibration = Seen({Pinhole("left")}, 7, 0.025, {1, 2, 3});
  Bundle& bundle = calibration.bundle;
  const Eigen::Matrix3d R = ExpRotation({0, 0, -7 * kDegree});
  bundle.T_rig_target.push_back({R, R * Eigen::Vector3d(0, 0.025, 0)});
  for (int m = 0; m < 3; ++m) {
    bundle.observations.push_back({.frame = 2, .marker = m, .seen = {}});
  }
  EXPECT_THAT(Codes(calibration), IsEmpty());
}

TEST(SceneFindings, FramesWithoutUsedObservationsAreNotPartOfThePath) {
  Calibration calibration = Seen({Pinhole("left")}, 20, 1, {1, 2, 3});
  for (BundleObservation& seen : calibration.bundle.observations) seen.used = seen.frame == 0;
  EXPECT_THAT(Codes(calibration), ElementsAre("scene_no_turning", "scene_no_parallax"));
}

TEST(SceneFindings, WithoutAScaleLengthsAreOpen) {
  Calibration calibration = Seen({Pinhole("left")}, 20, 1, {1, 2, 3});
  calibration.bundle.scale_distance.emplace();
  const auto first = [&] { return FindingsOfScene(calibration).at(0); };
  EXPECT_EQ(first().code, "scene_no_scale");
  EXPECT_EQ(first().grade, Grade::kGood);
  EXPECT_EQ(
      first().what,
      "No scale: all lengths (poses and points; the parameters have no lengths) are known up to "
      "one common factor.");
  calibration.bundle.cameras[0].is_master = false;
  EXPECT_EQ(first().grade, Grade::kBad);
  EXPECT_EQ(
      first().what,
      "No scale: all lengths (B of a plenoptic camera, translations in the rig, poses, points) "
      "are known up to one common factor.");
  calibration = Seen({Plenoptic("raw")}, 20, 1, {0.4, 1, 3});
  calibration.bundle.scale_distance.emplace();
  EXPECT_EQ(first().grade, Grade::kBad);
}

TEST(SceneFindings, BOfAPlenopticCameraIsGradedByItsRelativeError) {
  Calibration calibration = Seen({Plenoptic("raw")}, 20, 1, {0.35, 1, 3});
  const auto found = [&](double part) {
    calibration.uncertainty.param_std_errors[0][2] = part * 0.0005;
    return FindingsOfScene(calibration);
  };
  EXPECT_THAT(found(0.0099), IsEmpty());
  struct Case {
    double part;
    Grade grade;
    std::string what;
  };
  for (const Case& each :
       {Case{0.0101, Grade::kUsable, "raw: B is known to 1 %, and depths no better."},
        Case{0.099, Grade::kUsable, "raw: B is known to 9.9 %, and depths no better."},
        Case{0.11, Grade::kBad, "raw: B is known to 11 %, and depths no better."},
        Case{kInfinite, Grade::kBad, "raw: B is open, and with it all depths."}}) {
    const std::vector<Finding> findings = found(each.part);
    ASSERT_EQ(findings.size(), 1U);
    EXPECT_EQ(findings[0].code, "scene_B");
    EXPECT_EQ(findings[0].grade, each.grade);
    EXPECT_EQ(findings[0].what, each.what);
    EXPECT_EQ(findings[0].limit, 0.01);
    EXPECT_THAT(findings[0].cameras, ElementsAre("raw"));
  }
}

// Lengths in m decide on the grade of other defects, poor above 1 %.
TEST(SceneFindings, LengthsInsideOfAPlenopticCameraGradeItsDefects) {
  Calibration calibration = Seen({Plenoptic("raw")}, 11, 1, {0.35, 1, 3});
  const auto grade = [&](double part) {
    calibration.uncertainty.param_std_errors[0][0] = part * 0.016;
    calibration.uncertainty.param_std_errors[0][3] = 1e6;
    const std::vector<Finding> findings = FindingsOfScene(calibration);
    EXPECT_EQ(findings.at(0).code, "scene_no_turning");
    return findings.at(0).grade;
  };
  EXPECT_EQ(grade(0.0099), Grade::kGood);
  EXPECT_EQ(grade(0.0101), Grade::kUsable);
  EXPECT_EQ(grade(0.11), Grade::kBad);
}

// T = 1 / (1 - dx_R / dc_I), where c_ML = c_I b / (b + B), x_R = ... + c_ML (1 - 1/v) and
// 1/v = B (z - f) / (f z - b (z - f)).
double DepthFactorAt(double z) {
  constexpr double f = 0.016, b = 0.0155, B = 0.0005;
  const double inverse_v = B * (z - f) / (f * z - b * (z - f));
  return 1 / (1 - b / (b + B) * (1 - inverse_v));
}

TEST(SceneFindings, DepthFactorsFollowFromTheVirtualDepths) {
  Calibration calibration = Seen({Plenoptic("raw")}, 0, 0, {0.5, 0.8, 2});
  DepthFactors found = DepthFactorsOf(calibration.bundle, 0);
  EXPECT_NEAR(found.low, std::min(DepthFactorAt(0.5), DepthFactorAt(2)), 1e-6);
  EXPECT_NEAR(found.high, std::max(DepthFactorAt(0.5), DepthFactorAt(2)), 1e-6);
  for (BundleObservation& seen : calibration.bundle.observations) seen.used = seen.marker == 1;
  found = DepthFactorsOf(calibration.bundle, 0);
  EXPECT_NEAR(found.low, DepthFactorAt(0.8), 1e-6);
  EXPECT_NEAR(found.high, DepthFactorAt(0.8), 1e-6);
  for (BundleObservation& seen : calibration.bundle.observations) seen.used = false;
  EXPECT_EQ(DepthFactorsOf(calibration.bundle, 0).high, 0);
}

TEST(SceneFindings, VirtualDepthsHaveToDifferByHalf) {
  // The far point whose T is 1.5 times that of the near one, by bisection.
  const double near = 0.4;
  double low = near, high = 100;
  const bool grows = DepthFactorAt(10) > DepthFactorAt(near);
  const auto span = [&](double z) {
    return grows ? DepthFactorAt(z) / DepthFactorAt(near) : DepthFactorAt(near) / DepthFactorAt(z);
  };
  ASSERT_GT(span(high), 1.5);
  for (int i = 0; i < 60; ++i) (span((low + high) / 2) < 1.5 ? low : high) = (low + high) / 2;
  EXPECT_THAT(Codes(Seen({Plenoptic("raw")}, 20, 1, {near, 1.01 * low})), IsEmpty());
  Calibration calibration = Seen({Plenoptic("raw")}, 20, 1, {near, 0.99 * low});
  const auto last = [&] { return FindingsOfScene(calibration).back(); };
  EXPECT_EQ(last().code, "scene_depth_factors");
  EXPECT_EQ(last().grade, Grade::kUsable);
  EXPECT_NEAR(last().value.value(), span(0.99 * low), 1e-6);
  EXPECT_EQ(last().limit, 1.5);
  const double a = DepthFactorAt(near), b = DepthFactorAt(0.99 * low);
  EXPECT_EQ(last().what,
            fmt::format("raw: the points' virtual depths differ little (depth factor T from {:.2g} "
                        "to {:.2g}).",
                        std::min(a, b),
                        std::max(a, b)));
  calibration.uncertainty.param_std_errors[0][0] = 0.01;
  EXPECT_EQ(last().grade, Grade::kBad);
}

TEST(SceneFindings, PatchesAreNamed) {
  EXPECT_EQ(FindingOfPatches().code, "scene_patches");
  EXPECT_EQ(FindingOfPatches().grade, Grade::kUsable);
}

TEST(SceneScale, IsThatOfADistance) {
  Bundle bundle;
  bundle.cameras = {Pinhole("left")};
  EXPECT_FALSE(HasScale(bundle));
  bundle.distances.emplace_back();
  EXPECT_TRUE(HasScale(bundle));
}

TEST(SceneScale, IsThatOfKnownExtrinsicsOfASecondCamera) {
  Bundle bundle;
  bundle.cameras = {Pinhole("left"), Pinhole("right")};
  bundle.cameras[0].T_camera_rig.t.x() = 1;
  EXPECT_FALSE(HasScale(bundle));
  bundle.cameras[1].T_camera_rig.t.x() = -0.1;
  EXPECT_TRUE(HasScale(bundle));
  bundle.cameras[1].is_master = false;
  EXPECT_FALSE(HasScale(bundle));
}

TEST(SceneScale, IsThatOfAPriorOnExtrinsics) {
  Bundle bundle;
  bundle.cameras = {Pinhole("left"), Pinhole("right")};
  bundle.prior.emplace();
  bundle.prior->T_camera_rig = {{}, {Eigen::Matrix3d::Identity(), {-0.1, 0, 0}}};
  bundle.prior->unknowns = {{.camera = 1, .param = 0}};
  EXPECT_FALSE(HasScale(bundle));
  bundle.prior->unknowns.push_back({.camera = 0});
  EXPECT_FALSE(HasScale(bundle));
  bundle.prior->unknowns.push_back({.camera = 1});
  EXPECT_TRUE(HasScale(bundle));
  bundle.prior->T_camera_rig[1].t.setZero();
  EXPECT_FALSE(HasScale(bundle));
}

TEST(SceneScale, IsThatOfAKnownLengthInsideOfAPlenopticCamera) {
  Bundle bundle;
  bundle.cameras = {Plenoptic("raw")};
  BundleCamera& camera = bundle.cameras[0];
  EXPECT_FALSE(HasScale(bundle));
  camera.fixed[3] = true;  // c_x
  EXPECT_FALSE(HasScale(bundle));
  camera.fixed[2] = true;
  EXPECT_TRUE(HasScale(bundle));
  camera.fixed[2] = false;
  camera.rules.resize(9);
  camera.rules[3].prior = {{1, 1}};
  EXPECT_FALSE(HasScale(bundle));
  camera.rules[0].prior = {{1, 1}};
  EXPECT_TRUE(HasScale(bundle));
  camera.rules.clear();
  bundle.prior.emplace();
  bundle.prior->T_camera_rig.resize(1);
  bundle.prior->unknowns = {{.camera = 0, .param = 4}, {.camera = 1, .param = 2}};
  EXPECT_FALSE(HasScale(bundle));
  bundle.prior->unknowns.push_back({.camera = 0, .param = 2});
  EXPECT_TRUE(HasScale(bundle));
  bundle.prior.reset();
  bundle.cameras = {Pinhole("left")};
  bundle.cameras[0].fixed = std::vector<bool>(4, true);
  EXPECT_FALSE(HasScale(bundle));
}

TEST(ScenePoints, ArePlyWithTheNumbersOfUsedObservations) {
  Calibration calibration = Seen({Pinhole("left")}, 0, 0, {1, 2, 3});
  calibration.bundle.markers[2].number = 70;
  for (BundleObservation& seen : calibration.bundle.observations) {
    seen.used = seen.marker == 2 || (seen.marker == 0 && seen.frame == 1);
  }
  EXPECT_EQ(
      ScenePointsPly(calibration),
      "ply\nformat ascii 1.0\ncomment scene points, m, in the frame of the first frame's rig\n"
      "element vertex 2\nproperty double x\nproperty double y\nproperty double z\n"
      "property int point\nproperty int observations\nend_header\n"
      "0.01 0.02 1 0 1\n0.01 0.02 3 70 2\n");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
