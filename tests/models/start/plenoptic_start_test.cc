// SPDX-License-Identifier: Apache-2.0
//
// Initial guesses of plenoptic cameras from exact points of the models.
#include "models/start/plenoptic_start.h"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "models/registry.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr double kPixel = 20e-6;  // m
constexpr ImageSize kSize{640, 480};
constexpr double kPitch = 20;  // px
enum { kFocal, kMlaDistance, kSensorDistance, kCentreX, kCentreY, kA0, kA1, kB0, kB1, kPupil };

const CameraModel& ModelOf(const char* name) { return *FindModel(CameraModels(), name); }

/// A model's camera before a corner of two planes, and what it sees.
struct Problem {
  Problem(const char* name, std::vector<double> truth)
      : model(&ModelOf(name)), params(std::move(truth)) {
    const size_t count = model->params.size();
    params.resize(count, 0.0);
    given.resize(count);
    fixed.resize(count, false);
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 4; ++column) {
        markers[100 * row + column] = {0.06 * column, 0.06 * row, 0};
        markers[1000 + 100 * row + column] = {0.06 * column, 0, 0.06 + 0.06 * row};
      }
    }
    Random random(5);
    for (int f = 0; f < 4; ++f) {
      const Eigen::Matrix3d R = ExpRotation({0.7 + 0.1 * f, random.Uniform(-0.5, 0.5), 0.2 * f});
      const Eigen::Vector3d place(
          random.Uniform(-0.03, 0.03), random.Uniform(-0.03, 0.03), 0.5 + 0.08 * f);
      poses.push_back({R, place - R * Eigen::Vector3d(0.1, 0.05, 0.05)});
      views.push_back(See(f));
    }
  }

  [[nodiscard]] View See(int f) const {
    View view{"f" + std::to_string(f), {}};
    for (const auto& [number, position] : markers) {
      const Eigen::Vector3d p = poses[static_cast<size_t>(f)] * position;
      for (int i = -24; i <= 24; ++i) {
        for (int j = -14; j <= 14; ++j) {
          const Eigen::Vector2d c(320 + kPitch * (i + 0.5 * j), 240 + kPitch * j * std::sqrt(0.75));
          if (c.x() < 0 || c.y() < 0 || c.x() > 640 || c.y() > 480) continue;
          Observation seen{.marker = number, .values = {0, 0, c.x(), c.y()}};
          double x[2];
          if (!model->Project(params.data(), &kPixel, seen.values.data(), p, x)) continue;
          if ((Eigen::Vector2d(x[0], x[1]) - c).norm() > 0.5 * kPitch) continue;
          seen.values[0] = x[0];
          seen.values[1] = x[1];
          view.observations.push_back(seen);
        }
      }
    }
    return view;
  }

  [[nodiscard]] StartProblem Start() const {
    return {.views = views,
            .markers = &markers,
            .image_size = kSize,
            .config = {&kPixel, 1},
            .given = given,
            .fixed = &fixed};
  }

  const CameraModel* model;
  std::vector<double> params;
  std::vector<std::optional<double>> given;
  std::vector<bool> fixed;
  std::map<int, Eigen::Vector3d> markers = {};
  std::vector<RigidTransform> poses = {};
  std::vector<View> views = {};
};

std::vector<double> Thin() { return {0.016, 0.01535, 0.0005, 325, 236}; }

const CameraModel& Pinhole() { return ModelOf("pinhole-radial3"); }

/// Relative error of the parameters that have a size, and px of the principal point.
void ExpectNear(const std::vector<double>& found,
                const std::vector<double>& truth,
                double relative) {
  ASSERT_EQ(found.size(), truth.size());
  for (size_t i = 0; i < found.size(); ++i) {
    const double size = i < kCentreX ? truth[i]
                        : i < kA0    ? 1e3
                        : i < kA1    ? 1e3
                        : i == kA1   ? 1e9
                                     : 1;
    EXPECT_NEAR(found[i], truth[i], relative * std::max(size, std::abs(truth[i]))) << i;
  }
}

TEST(VirtualImage, IsThatOfAPinholeCamera) {
  const Problem problem("focused-plenoptic", Thin());
  const std::vector<View> views = VirtualImageViews(problem.views);
  ASSERT_EQ(views.size(), problem.views.size());
  const double focal = (problem.params[kMlaDistance] + problem.params[kSensorDistance]) / kPixel;
  size_t count = 0;
  for (size_t v = 0; v < views.size(); ++v) {
    EXPECT_EQ(views[v].frame, problem.views[v].frame);
    for (const Observation& seen : views[v].observations) {
      const Eigen::Vector3d p = problem.poses[v] * problem.markers.at(seen.marker);
      EXPECT_NEAR(seen.values[0], 325 + focal * p.x() / p.z(), 1e-6);
      EXPECT_NEAR(seen.values[1], 236 + focal * p.y() / p.z(), 1e-6);
      ++count;
    }
  }
  EXPECT_GT(count, 50U);
}

TEST(VirtualImage, LeavesOutMarkersWithoutAnAngleBetweenTheirRays) {
  const auto seen = [](int marker, double x, double lens_x) {
    return Observation{.marker = marker, .values = {x, 10, lens_x, 12}};
  };
  View view{"a", {seen(1, 5, 4), seen(2, 5, 4), seen(2, 6, 4), seen(3, 5, 4), seen(3, 15, 24)}};
  const std::vector<View> views = VirtualImageViews(std::vector<View>{view, {"b", {}}});
  ASSERT_EQ(views.size(), 2U);
  EXPECT_EQ(views[1].frame, "b");
  ASSERT_EQ(views[0].observations.size(), 1U);
  EXPECT_EQ(views[0].observations[0].marker, 3);
  // s = 1/2, T = 2: about the middle of the lenses, (14, 12), twice as far as the mean (10, 10).
  EXPECT_NEAR(views[0].observations[0].values[0], 14 + 2 * (10 - 14), 1e-9);
  EXPECT_NEAR(views[0].observations[0].values[1], 12 + 2 * (10 - 12), 1e-9);
}

TEST(PlenopticStart, GivesExactCamerasBack) {
  // Galilean and Keplerian: the virtual image behind the sensor, or in front of the micro lenses.
  for (const double b_L0 : {0.01535, 0.0178}) {
    std::vector<double> truth = Thin();
    truth[kMlaDistance] = b_L0;
    Problem problem("focused-plenoptic", truth);
    std::vector<StartCandidate> found = StartPlenoptic(Pinhole(), problem.Start());
    ASSERT_EQ(found.size(), 1U);
    ExpectNear(found[0].params, problem.params, 1e-4);
    problem.given[kFocal] = truth[kFocal];
    found = StartPlenoptic(Pinhole(), problem.Start());
    ASSERT_EQ(found.size(), 2U);
    for (const StartCandidate& each : found) ExpectNear(each.params, problem.params, 1e-4);
    problem.fixed[kFocal] = true;
    EXPECT_EQ(StartPlenoptic(Pinhole(), problem.Start()).size(), 1U);
  }
}

TEST(PlenopticStart, KeepsValuesOfTheUser) {
  Problem problem("focused-plenoptic", Thin());
  problem.given = {{}, 0.0151, 0.0006, 322.0, 238.0, 11.0, 12.0, 13.0, 14.0};
  const std::vector<StartCandidate> found = StartPlenoptic(Pinhole(), problem.Start());
  ASSERT_EQ(found.size(), 1U);
  EXPECT_THAT(std::vector<double>(found[0].params.begin() + 1, found[0].params.end()),
              ::testing::ElementsAre(0.0151, 0.0006, 322.0, 238.0, 11.0, 12.0, 13.0, 14.0));
  EXPECT_NEAR(found[0].params[kFocal], 0.016, 0.001);
}

TEST(PlenopticStart, TakesNoLengthsBelowZero) {
  const Problem seen("focused-plenoptic", Thin());
  for (const size_t k : {0U, 1U, 2U}) {
    Problem problem = seen;
    problem.given[k] = -0.001;
    problem.fixed[k] = true;
    EXPECT_TRUE(StartPlenoptic(Pinhole(), problem.Start()).empty()) << k;
  }
}

TEST(PlenopticStart, HasTheDistortionInMetres) {
  std::vector<double> truth = Thin();
  truth.resize(9, 0.0);
  truth[kA0] = 400;  // a hundredth at a radius of 5 mm
  const Problem problem("focused-plenoptic", truth);
  const std::vector<StartCandidate> found = StartPlenoptic(Pinhole(), problem.Start());
  ASSERT_EQ(found.size(), 1U);
  EXPECT_NEAR(found[0].params[kA0], 400, 80);
  EXPECT_NEAR(found[0].params[kFocal] / 0.016, 1, 0.02);
}

TEST(PlenopticStart, OfTooFewViewsIsNone) {
  Problem problem("focused-plenoptic", Thin());
  problem.views.clear();
  EXPECT_TRUE(StartPlenoptic(Pinhole(), problem.Start()).empty());
  problem.views = {View{"a", {}}};
  EXPECT_TRUE(StartPlenoptic(Pinhole(), problem.Start()).empty());
  Problem pupil("focused-plenoptic-pupil", Thin()), thick("plenoptic-thick", Thin());
  pupil.views.clear();
  thick.views.clear();
  EXPECT_TRUE(StartPlenopticPupil(Pinhole(), pupil.Start()).empty());
  EXPECT_TRUE(StartPlenopticThick(Pinhole(), thick.Start()).empty());
}

TEST(PlenopticStart, OfAPupilApartNeedsTheFocalLength) {
  for (const double b_P : {0.021, 0.011}) {
    std::vector<double> truth = Thin();
    truth.resize(10, 0.0);
    truth[kPupil] = b_P;
    Problem problem("focused-plenoptic-pupil", truth);
    problem.given[kFocal] = truth[kFocal];
    problem.fixed[kFocal] = true;
    const std::vector<StartCandidate> found = StartPlenopticPupil(Pinhole(), problem.Start());
    ASSERT_EQ(found.size(), 2U);
    EXPECT_EQ(found[0].params[kPupil], found[0].params[kMlaDistance]);
    ExpectNear(found[1].params, truth, 1e-3);
    EXPECT_NEAR(found[1].params[kPupil] / b_P, 1, 1e-3);
    if (b_P < 0.02) continue;
    problem.given[kPupil] = 0.03;
    problem.given[kMlaDistance] = 0.0152;
    problem.given[kSensorDistance] = 0.0007;
    for (const StartCandidate& each : StartPlenopticPupil(Pinhole(), problem.Start())) {
      EXPECT_EQ(each.params[kPupil], 0.03);
      EXPECT_EQ(each.params[kMlaDistance], 0.0152);
      EXPECT_EQ(each.params[kSensorDistance], 0.0007);
    }
  }
}

TEST(PlenopticStart, OfAThickLensTakesTheStatedPupil) {
  for (const double w_P : {0.0, 40.0}) {
    std::vector<double> truth = Thin();
    truth.resize(14, 0.0);
    truth[kPupil] = w_P;
    Problem problem("plenoptic-thick", truth);
    problem.given[kPupil] = w_P;
    std::vector<StartCandidate> found = StartPlenopticThick(Pinhole(), problem.Start());
    ASSERT_FALSE(found.empty());
    ExpectNear(found[0].params, {truth.begin(), truth.begin() + 10}, 1e-3);
    for (const StartCandidate& each : found) EXPECT_EQ(each.params[kPupil], w_P);
    if (w_P > 0) continue;
    problem.given[kFocal] = 0.0161;
    problem.given[kSensorDistance] = 0.0006;
    found = StartPlenopticThick(Pinhole(), problem.Start());
    EXPECT_EQ(found[0].params[kFocal], 0.0161);
    EXPECT_EQ(found[0].params[kSensorDistance], 0.0006);
    // f_L - b_L0 follows from the images.
    EXPECT_NEAR(0.0161 - found[0].params[kMlaDistance], 0.016 - 0.01535, 1e-5);
    problem.given[kMlaDistance] = 0.015;
    EXPECT_EQ(StartPlenopticThick(Pinhole(), problem.Start())[0].params[kMlaDistance], 0.015);
  }
  Problem thin("plenoptic-thick", {0.016, 0.01535, 0.0005, 325, 236, 0, 0, 0, 0, 1 / 0.01535});
  const std::vector<StartCandidate> found = StartPlenopticThick(Pinhole(), thin.Start());
  ASSERT_EQ(found.size(), 1U);
  EXPECT_DOUBLE_EQ(found[0].params[kPupil], 1 / found[0].params[kMlaDistance]);
  ExpectNear(found[0].params, {thin.params.begin(), thin.params.begin() + 10}, 1e-3);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
