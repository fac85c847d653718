// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/summary.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <numbers>
#include <tuple>

#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::Not;

constexpr double kDegrees = 180 / std::numbers::pi;

// Sets a camera's rotation vector in its rig, degrees, and its centre.
void Place(const Eigen::Vector3d& turn, BundleCamera* camera) {
  const double angle = turn.norm();
  camera->T_camera_rig.R = Eigen::AngleAxisd(-angle / kDegrees, turn / angle).matrix();
  camera->T_camera_rig.t = -camera->T_camera_rig.R * Eigen::Vector3d(0.12, -0.03, 0.04);
}

// A rig of two cameras before two targets; all standard errors are set by hand.
Calibration Rig() {
  Calibration rig;
  rig.bundle = TrueBundle(MakeProblem(4, {.cameras = 2, .frames = 3}));
  rig.frames = {"a", "b", "c"};
  rig.converged = true;
  rig.iterations = 1;
  rig.fits.resize(2);
  CameraFit &left_fit = rig.fits[0], &right_fit = rig.fits[1];
  std::tie(left_fit.points, left_fit.rejected, left_fit.views) = std::tuple(210, 2, 3);
  std::tie(left_fit.rms, left_fit.noise_sigma) = std::tuple(0.25, 0.125);
  std::tie(right_fit.points, right_fit.views, right_fit.common_noise) = std::tuple(1, 1, 0.0625);
  std::tie(right_fit.rms, right_fit.noise_sigma, right_fit.detector_sigma) =
      std::tuple(0.5, 0.25, 0.2);
  rig.bundle.cameras[0].name = "left";
  BundleCamera& right = rig.bundle.cameras[1];
  right.name = "right";
  right.image_size = {800, 600};
  right.params = {500.25, 501, 320, 240, -0.25, 0.0625, 0};
  right.fixed[6] = true;
  Place({1, 3, -2}, &right);
  Uncertainty& errors = rig.uncertainty;
  errors.param_std_errors = {std::vector<double>(7, 0.01),
                             {0.5, 0.01, 12, 0.2, 0.003, std::numeric_limits<double>::infinity()}};
  errors.param_std_errors[1].push_back(0);
  errors.extrinsics_covariance.assign(2, Matrix6d::Zero());
  rig.bundle.targets = {{"board", {}, true}, {"cube", {}, false}};
  rig.bundle.targets[1].T_target_own = {
      Eigen::AngleAxisd(90 / kDegrees, Eigen::Vector3d::UnitZ()).matrix(), {0, 0, 0.25}};
  errors.target_index = {-1, 1};
  errors.covariance = Eigen::MatrixXd::Zero(8, 8);
  errors.covariance.diagonal() << 1, 1e-4, 1e-4, 4e-6, 1e-4, 1e-4, 4e-4, 25e-6;
  return rig;
}

TEST(Summary, HasTheFitTheParametersAndThePosesOfARig) {
  Calibration rig = Rig();
  const std::string text = Summary(rig);
  EXPECT_THAT(text,
              ::testing::StartsWith("2 cameras, 3 frames, 70 markers; 1 iteration, "
                                    "converged\n\nleft  (pinhole-radial3, 1280 x 960 px)\n"));
  EXPECT_THAT(text,
              HasSubstr("  RMS reprojection error 0.2500 px over 210 points in 3 images, 2 "
                        "rejected; noise 0.1250 px per coordinate\n    f_x "));
  EXPECT_THAT(text,
              HasSubstr("\nright  (pinhole-radial3, 800 x 600 px)\n"
                        "  RMS reprojection error 0.5000 px over 1 point in 1 image, 0 rejected; "
                        "noise 0.2500 px per coordinate (detector: 0.2000), 0.0625 of it common to "
                        "the points of a marker\n"
                        "    f_x    500.25 +- 0.50 px\n"
                        "    f_y    501.000 +- 0.010 px\n"
                        "    c_x    320 +- 12 px\n"
                        "    c_y    240.00 +- 0.20 px\n"
                        "    A_0    -0.2500 +- 0.0030\n"
                        "    A_1    0.0625  (not determined)\n"
                        "    A_2    0  (fixed)\n"
                        "    extrinsics relative to left: baseline 130 mm, centre (120.000, "
                        "-30.000, 40.000) mm\n"
                        "    rotation vector (1, 3, -2) degrees\n"));
  // The target's rotation and distance, with the part of its errors along its direction.
  EXPECT_THAT(text,
              HasSubstr("\ntarget cube: 250.0 +- 2.0 mm from board, rotation vector (0.00 +- 0.57, "
                        "0.00 +- 0.57, 90.0 +- 1.1) degrees\n"));
  EXPECT_THAT(text, Not(HasSubstr("target board:")));
  EXPECT_THAT(text, Not(HasSubstr("larger than stated")));
  EXPECT_THAT(text, Not(HasSubstr("refined markers")));
  rig.converged = false;
  rig.iterations = 40;
  EXPECT_THAT(Summary(rig), HasSubstr("; 40 iterations, NOT CONVERGED\n"));
}

TEST(Summary, HasTheErrorsOfTheExtrinsics) {
  Calibration rig = Rig();
  Place({0.5, 0.25, -0.25}, &rig.bundle.cameras[1]);
  rig.uncertainty.extrinsics_covariance[1].diagonal() << 2e-6, 2e-6, 2e-6, 4e-6, 1e-6, 9e-6;
  EXPECT_THAT(Summary(rig),
              HasSubstr("baseline 130.0 +- 1.4 mm, centre (120.000, -30.000, 40.000) mm\n"
                        "    rotation vector (0.50 +- 0.11, 0.250 +- 0.057, -0.25 +- 0.17) "
                        "degrees\n"));
}

TEST(Summary, HasTheRulesOfParameters) {
  Calibration rig = Rig();
  for (BundleCamera& camera : rig.bundle.cameras) {
    camera.rules.resize(7);
    camera.at_bound.assign(7, false);
  }
  BundleCamera& right = rig.bundle.cameras[1];
  right.rules[0].tied_to = ParamIndex{0, 0};
  right.rules[1].tied_to = ParamIndex{1, 0};
  right.rules[2].prior = {.value = 319.5, .sigma = 2};
  right.at_bound[3] = true;
  rig.jackknife.emplace().param_std_errors.assign(2, std::vector<double>(7, 0.025));
  const std::string text = Summary(rig);
  EXPECT_THAT(text,
              HasSubstr("    f_x    500.25 +- 0.50 px  (tied to left.f_x)  (jackknife +- "
                        "0.025)\n"));
  EXPECT_THAT(text, HasSubstr("    f_y    501.000 +- 0.010 px  (tied to f_x)"));
  EXPECT_THAT(text, HasSubstr("    c_x    320 +- 12 px  (prior 319.5 +- 2)"));
  EXPECT_THAT(text, HasSubstr("    c_y    240.00 +- 0.20 px  (at its bound)"));
  EXPECT_THAT(text, HasSubstr("    A_2    0  (fixed)\n"));
}

TEST(Summary, HasTheScaleAndTheRefinedMarkers) {
  Calibration rig = Rig();
  rig.bundle.scales = {{.target = 1, .value = 0.0125}};
  rig.uncertainty.scale_index = 7;
  EXPECT_THAT(Summary(rig), HasSubstr("\ncube.scale: 1.25 +- 0.50 % larger than stated\n"));
  rig.bundle.scales.clear();
  rig.bundle.marker_freedom = MarkerFreedom::FromSigma(0.0005);
  for (size_t m = 0; m < rig.bundle.markers.size(); ++m) {
    rig.bundle.markers[m].position = rig.bundle.Expected(static_cast<int>(m));
  }
  rig.bundle.markers[8].position.z() -= 0.004;
  rig.bundle.markers[8].number = 88;
  rig.bundle.markers[9].position.x() += 0.003;
  // sqrt((4^2 + 3^2) / 70)
  EXPECT_THAT(Summary(rig),
              HasSubstr("\nrefined markers are 0.598 mm RMS from their nominal positions "
                        "(tolerance 0.500 mm per coordinate), at most 4.000 mm (marker 88)\n"));
}

TEST(Summary, HasNoiseFloorLensTypesAndTimes) {
  Calibration rig = Rig();
  CameraFit& fit = rig.fits[0];
  fit.noise_floor = NoiseFloor{0.2, 0.18, 0.1, 400};
  fit.noise_floor_all = NoiseFloor{0.4, 0.36, 0.3, 420};
  fit.rms_all = 0.5;
  fit.lens_types = {{0, {.points = 100, .rms = 0.5}}, {2, {.points = 7, .rms = 0.25}}};
  EXPECT_THAT(
      Summary(rig),
      HasSubstr("  noise floor of the affine law 0.2000 px, with third order 0.1800 px; RMS "
                "of a coordinate 0.1250 px, noise floor 0.1000 (400 degrees of freedom), "
                "with third order 0.0900; with the rejected points 0.2500, noise floor "
                "0.3000, with third order 0.1800\n"
                "  RMS by lens type: 0.5000 px over 100, 0.2500 px over 7 points\n"));
  EXPECT_THAT(Summary(rig), Not(HasSubstr("by the clock of")));
  AddNuisance(nuisances::kTimeShift, 1, &rig.bundle.cameras[1]);
  rig.bundle.cameras[1].at_bound.assign(8, false);
  rig.bundle.cameras[1].params.back() = 0.0125;
  rig.uncertainty.param_std_errors[1].push_back(0.0005);
  EXPECT_THAT(Summary(rig),
              HasSubstr("    images later than their times by 12.50 +- 0.50 ms, by the clock of "
                        "left\n"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
