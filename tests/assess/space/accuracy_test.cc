// SPDX-License-Identifier: Apache-2.0
//
// Predicted accuracy of a pair of pinhole cameras side by side, where each part has a formula.
#include "assess/space/accuracy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "models/registry.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

constexpr double kFocal = 800, kBase = 0.2, kNoise = 0.1;  // px, m, px

struct PairOptions {
  double sigma_f = 0, sigma_turn = 0, sigma_base = 0;  // px, rad, m: f_x of both, right camera
  double correlation = 0;                              // of the right camera's f_x and c_x
  double sigma_c = 0;                                  // px, of c_x of the right camera
  bool exact = false;                                  // extrinsics have no standard errors
};

CalibrationRecord ParallelPair(const PairOptions& options) {
  CalibrationRecord record;
  for (size_t c = 0; c < 2; ++c) {
    CalibratedCamera& camera = record.cameras.emplace_back();
    camera.name = c == 0 ? "left" : "right";
    camera.model = FindModel(CameraModels(), "pinhole");
    camera.image_size = {640, 480};
    camera.params = {kFocal, kFocal, 319.5, 239.5};
    camera.covariance = Eigen::MatrixXd::Zero(4, 4);
    camera.covariance(0, 0) = std::pow(options.sigma_f, 2);
    camera.fit.noise_sigma = kNoise;
  }
  CalibratedCamera& right = record.cameras[1];
  right.T_camera_rig.t.x() = -kBase;
  right.sigma_xi << options.sigma_base, 0, 0, 0, options.sigma_turn, 0;
  // An extrinsic without a standard error would hold all of them.
  if (!options.exact) right.sigma_xi = right.sigma_xi.cwiseMax(1e-9);
  right.covariance(2, 2) = std::pow(options.sigma_c, 2);
  right.covariance(0, 2) = right.covariance(2, 0) =
      options.correlation * options.sigma_f * options.sigma_c;
  return record;
}

RigAccuracy Predicted(const CalibrationRecord& record, const AccuracyOptions& options) {
  return PredictAccuracy(record, {"left", "right"}, {}, options);
}

// Of the cell nearest to the middle of the image.
AccuracyCell MiddleOf(const RigAccuracy& accuracy, size_t distance = 0) {
  const auto& cells = accuracy.distances[distance].cells;
  return *std::ranges::min_element(cells, {}, [&](const AccuracyCell& cell) {
    return (accuracy.grid.Middle(cell.cell) - Eigen::Vector2d(319.5, 239.5)).norm();
  });
}

TEST(Accuracy, NoiseOfAParallelPairIsThatOfItsDisparity) {
  const RigAccuracy made = Predicted(ParallelPair({.sigma_base = 1e-9}), {.distances = {1, 4}});
  for (size_t d = 0; d < 2; ++d) {
    const double z = made.distances[d].distance;
    const double expected = z * z / (kFocal * kBase) * std::sqrt(2) * kNoise;
    // The point of a parallel pair lies at the middle of both places: no cross terms in z.
    EXPECT_NEAR(MiddleOf(made, d).z.noise, expected, 1e-3 * expected);
    EXPECT_NEAR(made.distances[d].z.noise, expected, 1e-3 * expected);
    EXPECT_NEAR(made.distances[d].relative, expected / z, 0.05 * expected / z);
  }
  EXPECT_LT(made.distances[0].cells.size(), made.grid.Cells());  // not in both images
  EXPECT_GT(made.distances[1].cells.size(), made.distances[0].cells.size());
  ASSERT_TRUE(made.relative_1_percent && made.beyond);
  EXPECT_NEAR(*made.relative_1_percent, 0.01 * kFocal * kBase / (std::sqrt(2) * kNoise), 0.1);
  EXPECT_NEAR(*made.beyond, kFocal * kBase / (3 * std::sqrt(2) * kNoise), 5);
}

TEST(Accuracy, OfTheCalibrationIsThatOfTheNoiseAtOneDistance) {
  // z^2 / (f b) times sqrt(2) noise = z / b times the error of the base: nearer by this, farther
  // off by the noise.
  constexpr double kLength = 2e-3;
  const RigAccuracy made =
      Predicted(ParallelPair({.sigma_base = kLength}), {.distances = {1, 4, 40}});
  ASSERT_TRUE(made.calibration_equals_noise);
  const double expected = kLength * kFocal / (std::sqrt(2) * kNoise);
  EXPECT_NEAR(*made.calibration_equals_noise, expected, 0.01 * expected);
  EXPECT_FALSE(Predicted(ParallelPair({.sigma_base = 1e-9}), {.distances = {1, 4}})
                   .calibration_equals_noise);
}

TEST(Accuracy, ATurnAndABaseLengthMoveZAsGeometryHasIt) {
  constexpr double kTurn = 1e-4, kLength = 1e-4, z = 3;
  const AccuracyCell turned =
      MiddleOf(Predicted(ParallelPair({.sigma_turn = kTurn}), {.distances = {z}}));
  // Vergence moves the right image by f turn.
  EXPECT_NEAR(turned.z.calibration, z * z / kBase * kTurn, 0.02 * turned.z.calibration);
  const AccuracyCell scaled =
      MiddleOf(Predicted(ParallelPair({.sigma_base = kLength}), {.distances = {z}}));
  EXPECT_NEAR(scaled.z.calibration, z * kLength / kBase, 1e-3 * scaled.z.calibration);
  // A length grows with the base as all space does.
  ASSERT_TRUE(scaled.across);
  EXPECT_NEAR(scaled.across->calibration, 0.1 * kLength / kBase, 1e-3 * scaled.across->calibration);
  EXPECT_GT(scaled.across->noise, 0);
}

TEST(Accuracy, WhatIsKnownIsConditionedUponNotLeftOut) {
  // c_x and f_x of the right camera correlate. With known intrinsics only the turn is left; with
  // known extrinsics all but the turn.
  constexpr double kTurn = 1e-4;
  const CalibrationRecord record =
      ParallelPair({.sigma_f = 0.5, .sigma_turn = kTurn, .correlation = 0.8, .sigma_c = 0.3});
  const RigAccuracy made = Predicted(record, {.distances = {3}});
  ASSERT_THAT(made.known, ::testing::ElementsAre("intrinsics", "extrinsics", "left", "right"));
  const AccuracyCell cell = MiddleOf(made);
  const double turn = 9 / kBase * kTurn;
  EXPECT_NEAR(cell.z_if_known[0], std::hypot(cell.z.noise, turn), 0.02 * cell.z_if_known[0]);
  EXPECT_NEAR(std::pow(cell.z_if_known[1], 2) + turn * turn,
              std::pow(cell.z.Sigma(), 2),
              0.02 * std::pow(cell.z.Sigma(), 2));
  for (const double known : cell.z_if_known) EXPECT_LE(known, cell.z.Sigma());
}

TEST(Accuracy, CamerasThatDoNotExposeAtOnceAddTheirShifts) {
  CalibrationRecord record = ParallelPair({.sigma_base = 1e-9});
  record.jitter = JitterRecord{.translation_sigma = 1e-3, .rotation_sigma = 0};
  const RigAccuracy made = Predicted(record, {.distances = {2}});
  const AccuracyCell cell = MiddleOf(made);
  // Each camera's shift across moves the disparity by f / z.
  EXPECT_NEAR(cell.z.jitter, std::sqrt(2) * 2 / kBase * 1e-3, 0.02 * cell.z.jitter);
  EXPECT_THAT(made.findings,
              ::testing::Contains(::testing::Field(&Finding::code, "accuracy_not_rigid")));
}

TEST(Accuracy, TheSizeOfTheTargetScalesAllOfSpace) {
  // All of the base's error is that of the target's size.
  constexpr double kScale = 5e-3;
  CalibrationRecord record = ParallelPair({.sigma_base = kScale * kBase});
  record.target_scales = {{"target.scale", {0, kScale}}};
  const RigAccuracy made = Predicted(record, {.distances = {2}});
  const AccuracyCell cell = MiddleOf(made);
  EXPECT_NEAR(cell.z.scale, 2 * kScale, 1e-6);
  EXPECT_LT(cell.z.calibration, 0.05 * cell.z.scale);
  ASSERT_TRUE(cell.across);
  EXPECT_NEAR(cell.across->scale, 0.1 * kScale, 1e-6);
  EXPECT_THAT(made.findings,
              ::testing::Contains(::testing::Field(&Finding::code, "accuracy_scale")));
}

TEST(Accuracy, NoiseThatIsStatedReplacesTheCalibrations) {
  const CalibrationRecord record = ParallelPair({.sigma_base = 1e-9});
  AccuracyOptions options{.distances = {2}};
  options.noise = {{"left", 0.3}, {"right", 0.4}};
  const AccuracyCell cell = MiddleOf(Predicted(record, options));
  EXPECT_NEAR(cell.z.noise, 4 / (kFocal * kBase) * 0.5, 1e-3 * cell.z.noise);
}

TEST(Accuracy, OneOrdinaryCameraHasLateralErrorsAtAKnownDistance) {
  const CalibrationRecord record = ParallelPair({.sigma_f = 0.8});
  const RigAccuracy made = PredictAccuracy(record, {"left"}, {}, {.distances = {2}});
  EXPECT_FALSE(made.has_depth);
  const AccuracyCell cell = MiddleOf(made);
  EXPECT_NEAR(cell.lateral.noise, 2 * kNoise / kFocal, 1e-6);
  EXPECT_EQ(cell.z.Sigma(), 0);
  ASSERT_TRUE(cell.across);
  EXPECT_FALSE(cell.along);
  EXPECT_NEAR(cell.across->calibration, 0.1 * 0.8 / kFocal, 1e-3 * cell.across->calibration);
}

std::vector<std::string> CodesOf(const RigAccuracy& made) {
  std::vector<std::string> codes;
  for (const Finding& finding : made.findings) {
    codes.push_back(finding.code);
    EXPECT_EQ(finding.cameras, made.cameras);
    EXPECT_FALSE(finding.remedy.empty());
  }
  return codes;
}

TEST(Accuracy, NamesTheLargestPartAndHowToLowerIt) {
  using ::testing::ElementsAre;
  using ::testing::HasSubstr;
  // Noise of 1.77 mm at 1 m; a base wrong by a thousandth moves z by 1 mm there, by 6 mm half of
  // it.
  const auto find = [](double relative_base) {
    return Predicted(ParallelPair({.sigma_base = relative_base * kBase}), {.distances = {2}});
  };
  const double noise = 4 / (kFocal * kBase) * std::sqrt(2) * kNoise;
  const RigAccuracy noisy = find(0.2 * noise);
  EXPECT_THAT(CodesOf(noisy), ElementsAre("accuracy_noise"));
  EXPECT_THAT(noisy.findings[0].what, HasSubstr("At 2 m sigma of z is "));
  EXPECT_THAT(noisy.findings[0].what, HasSubstr(", of which noise makes 3.5 mm."));
  // (1 / 0.4)^2 = 6.25 frames.
  EXPECT_THAT(noisy.findings[0].remedy, HasSubstr("Average frames of what is at rest: 7 bring"));
  EXPECT_THAT(noisy.findings[0].remedy, HasSubstr("use a longer base"));
  const RigAccuracy exact = find(0);
  EXPECT_THAT(CodesOf(exact), ElementsAre("accuracy_noise"));
  EXPECT_EQ(exact.findings[0].remedy, "Average frames of what is at rest. Or use a longer base.");
  const RigAccuracy uncertain = find(noise);
  EXPECT_THAT(CodesOf(uncertain), ElementsAre("accuracy_calibration"));
  EXPECT_THAT(uncertain.findings[0].what, HasSubstr(", of which the calibration makes 7.1 mm."));
  EXPECT_THAT(uncertain.findings[0].remedy, HasSubstr("depth@2m"));
}

TEST(Accuracy, NamesDistancesAtWhichNothingIsKnown) {
  using ::testing::Contains;
  using ::testing::Not;
  CalibrationRecord record = ParallelPair({.sigma_base = 1e-9});
  // beyond = f base / (3 sqrt(2) noise) = 377 m.
  EXPECT_THAT(CodesOf(Predicted(record, {.distances = {360}})), Not(Contains("accuracy_far")));
  EXPECT_THAT(CodesOf(Predicted(record, {.distances = {400}})), Contains("accuracy_far"));
  // Markers at 1 to 2 m.
  record.frames.push_back({"frame", {}});
  for (int m = 0; m < 4; ++m) {
    record.markers[m].position = {0.1 * m, 0.1 * (m % 2), 1.0 + m / 3.0};
    for (CalibratedCamera& camera : record.cameras) {
      camera.residuals.push_back({.frame = 0, .marker = m, .values = {320, 240}, .used = true});
    }
  }
  const RigAccuracy made = Predicted(record, {});
  std::vector<double> distances;
  for (const AccuracyAtDistance& at : made.distances) distances.push_back(at.distance);
  EXPECT_THAT(distances, ::testing::ElementsAre(1, 2, 4, 10, 20));
  EXPECT_THAT(CodesOf(made), Contains("accuracy_extrapolated"));
  EXPECT_THAT(CodesOf(Predicted(record, {.distances = {2, 3}})),
              Not(Contains("accuracy_extrapolated")));
  record.findings.push_back({.code = "residual_pattern"});
  EXPECT_THAT(CodesOf(Predicted(record, {.distances = {2}})), Contains("accuracy_model"));
}

TEST(Accuracy, RefusesWhatHasNoStandardErrorsOrNoDistances) {
  using ::testing::HasSubstr;
  const auto refuses = [](const CalibrationRecord& record, const AccuracyOptions& options) {
    return testing::RefusalOf([&] { Predicted(record, options); });
  };
  EXPECT_THAT(refuses(ParallelPair({.exact = true}), {.distances = {1}}),
              HasSubstr("no standard errors"));
  EXPECT_THAT(refuses(ParallelPair({.sigma_base = 1e-4}), {}), HasSubstr("--distances"));
  CalibrationRecord silent = ParallelPair({.sigma_base = 1e-4});
  silent.cameras[1].fit.noise_sigma = 0;
  EXPECT_THAT(refuses(silent, {.distances = {1}}), HasSubstr("--noise right="));
  EXPECT_THAT(refuses(ParallelPair({.sigma_base = 1e-4}),
                      {.distances = {1}, .frame = SpaceFrame::kHousing}),
              HasSubstr("residuals.csv"));
}

TEST(Accuracy, SetsAreThePairsThePlenopticCamerasAndAll) {
  CalibrationRecord record;
  for (const char* name : {"a", "b", "c"}) {
    record.cameras.emplace_back().name = name;
    record.cameras.back().model = FindModel(CameraModels(), "pinhole");
  }
  record.cameras[2].model = FindModel(CameraModels(), "focused-plenoptic");
  using Set = std::vector<std::string>;
  EXPECT_THAT(CameraSets(record),
              ::testing::ElementsAre(Set{"a", "b"}, Set{"c"}, Set{"a", "b", "c"}));
  record.cameras.resize(2);
  EXPECT_THAT(CameraSets(record), ::testing::ElementsAre(Set{"a", "b"}));
}

}  // namespace TEST_FILE
}  // namespace plenocal
