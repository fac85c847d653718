// SPDX-License-Identifier: Apache-2.0
//
// Prints of another size than stated, with and without measured distances.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "calib/base/statistics.h"
#include "calib/estimate/calibrate.h"
#include "calib/estimate/describe.h"
#include "calib/files/calibration_file.h"
#include "calib/space/point_fit.h"
#include "models/registry.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::Contains;
using ::testing::Not;

constexpr double kScaleSigma = 0.005, kBar = 1e-4;  // relative

// A pair whose target is larger than stated by `scale`, with a measured diagonal.
testing::SyntheticProblem Print(unsigned seed, double scale, bool measured) {
  testing::SyntheticProblem problem =
      testing::MakeProblem(seed, {.cameras = 2, .frames = 12, .noise = 0.1});
  const double length = (problem.markers.at(0) - problem.markers.at(69)).norm();
  for (auto& [number, position] : problem.input.markers) position /= 1 + scale;
  problem.input.marker_freedom = MarkerFreedom::Held();
  problem.input.scales = {{.sigma = kScaleSigma}};
  if (measured) {
    const double error = testing::Random(seed).Gaussian(kBar * length);
    problem.input.distances = {{.markers_a = {0},
                                .markers_b = {69},
                                .length = length + error,
                                .sigma = kBar * length,
                                .name = "marker 0 to marker 69"}};
  }
  return problem;
}

double Baseline(const RigidTransform& T) { return T.t.norm(); }

TEST(TargetScale, IsAsExactAsTheMeasuredDistance) {
  constexpr unsigned kRuns = 24;
  double squares = 0, baselines = 0;
  for (unsigned seed = 0; seed < kRuns; ++seed) {
    testing::Random random(100 + seed);
    const double scale = random.Gaussian(kScaleSigma);
    const testing::SyntheticProblem problem = Print(seed, scale, true);
    const CalibrationRecord record = Describe(Calibrate(problem.input, {}));
    ASSERT_EQ(record.target_scales.size(), 1U);
    const auto& [name, found] = record.target_scales[0];
    EXPECT_EQ(name, "target.scale");
    EXPECT_NEAR(found.sigma / kBar, 1, 0.1);
    squares += std::pow((found.value - scale) / found.sigma, 2);
    const CalibratedCamera& camera = record.cameras[1];
    const Vector6d xi = Log(camera.T_camera_rig);
    const Eigen::Vector3d along = xi.head<3>().normalized();
    const double error = Baseline(camera.T_camera_rig) - Baseline(problem.T_camera_rig[1]);
    const double sigma =
        std::abs(along.x()) > 0.9 ? camera.sigma_xi[0] : camera.sigma_xi.head<3>().norm();
    baselines += std::pow(error / sigma, 2);
    EXPECT_THAT(testing::CodesOf(record.findings), Not(Contains("target_scale_contradicted")));
  }
  EXPECT_GT(squares, ChiSquareQuantile(kRuns, 1 - 1e-3));
  EXPECT_LT(squares, ChiSquareQuantile(kRuns, 1e-3));
  EXPECT_LT(baselines, ChiSquareQuantile(kRuns, 1e-3));
}

TEST(TargetScale, IsInTheStandardErrorsOfLengthsInSpace) {
  const testing::SyntheticProblem problem = Print(3, 0, false);
  const CalibrationRecord record = Describe(Calibrate(problem.input, {}));
  EXPECT_NEAR(record.target_scales[0].second.sigma / kScaleSigma, 1, 1e-3);
  const CalibratedCamera& camera = record.cameras[1];
  // The baseline is known as the print is.
  const Eigen::Vector3d t = camera.T_camera_rig.t;
  const SpaceRig rig = MakeSpaceRig(record, {});
  Eigen::RowVectorXd along = Eigen::RowVectorXd::Zero(rig.Size());
  for (size_t i = 0; i < rig.unknowns.size(); ++i) {
    const CalibrationPrior::Unknown& unknown = rig.unknowns[i];
    if (unknown.camera == 1 && !unknown.param && unknown.component < 3) {
      along[static_cast<Eigen::Index>(i)] = t.normalized()[unknown.component];
    }
  }
  EXPECT_GT((along * rig.root).norm(), 0.99 * kScaleSigma * t.norm());
  EXPECT_LT((along * rig.root).norm(), 1.5 * kScaleSigma * t.norm());
}

TEST(TargetScale, IsNamedWhereItContradictsItsPrior) {
  const CalibrationRecord record = Describe(Calibrate(Print(1, 0.03, true).input, {}));
  EXPECT_THAT(testing::CodesOf(record.findings), Contains("target_scale_contradicted"));
  // So is a distance that contradicts a size without error.
  testing::SyntheticProblem exact = Print(1, 0.003, true);
  exact.input.scales.clear();
  const CalibrationRecord held = Describe(Calibrate(exact.input, {}));
  EXPECT_TRUE(held.target_scales.empty());
  EXPECT_THAT(testing::CodesOf(held.findings), Contains("target_scale_contradicted"));
}

TEST(TargetScale, HasOneNumberForEachAxis) {
  testing::SyntheticProblem problem = Print(5, 0, false);
  for (auto& [number, position] : problem.input.markers) position.y() *= 0.996;
  problem.input.scales = {{.axes = Eigen::Vector3d::UnitX(), .sigma = kScaleSigma},
                          {.axes = Eigen::Vector3d::UnitY(), .sigma = kScaleSigma}};
  const CalibrationRecord record = Describe(Calibrate(problem.input, {}));
  ASSERT_EQ(record.target_scales.size(), 2U);
  const auto& [x, y] = std::pair(record.target_scales[0], record.target_scales[1]);
  EXPECT_EQ(x.first, "target.scale_x");
  EXPECT_EQ(y.first, "target.scale_y");
  // Images show the ratio, the prior shares it out.
  EXPECT_NEAR(y.second.value - x.second.value, 1 / 0.996 - 1, 3e-4);
  EXPECT_THAT(record.correlations.names, Contains("target.scale_x"));
}

TEST(TargetScale, LeavesOutDistancesThatNoImageShows) {
  testing::SyntheticProblem problem = Print(2, 0, true);
  for (CameraInput& camera : problem.input.cameras) {
    for (View& view : camera.views) {
      std::erase_if(view.observations, [](const Observation& seen) { return seen.marker == 69; });
    }
  }
  const Calibration calibration = Calibrate(problem.input, {});
  EXPECT_TRUE(calibration.bundle.distances.empty());
  ASSERT_FALSE(calibration.left_out.empty());
  EXPECT_EQ(calibration.left_out.back().where, "distance marker 0 to marker 69");
  EXPECT_EQ(calibration.left_out.back().reason, "no image shows marker 69");
}

}  // namespace TEST_FILE
}  // namespace plenocal
