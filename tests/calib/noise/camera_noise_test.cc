// SPDX-License-Identifier: Apache-2.0
//
// Noise of simulated observations about the true state: residuals are the noise that was drawn, and
// no unknown has used a degree of freedom.
#include "calib/noise/camera_noise.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

using testing::MakeProblem;
using testing::Random;
using testing::TrueBundle;

// A standard deviation from n numbers has a relative standard error of 1 / sqrt(2 n); some 1000
// coordinates and more here, and four of them.
constexpr double kTolerance = 0.1;

Bundle ExactBundle(int frames) { return TrueBundle(MakeProblem(3, {.frames = frames})); }

// Adds Gaussian errors of standard deviation `sigma(i)` to observation i.
void AddNoise(Random* random, const std::function<double(size_t)>& sigma, Bundle* bundle) {
  for (size_t i = 0; i < bundle->observations.size(); ++i) {
    for (int r = 0; r < 2; ++r) {
      bundle->observations[i].seen.values[static_cast<size_t>(r)] += random->Gaussian(sigma(i));
    }
  }
}

void AssumeSigmas(double sigma, Bundle* bundle) {
  for (BundleObservation& observation : bundle->observations) observation.assumed_sigma = sigma;
}

// `count` replicates of each observation, whose errors are `common` to them and their `own`.
void Replicate(int count, double common, double own, Random* random, Bundle* bundle) {
  std::vector<BundleObservation> replicates;
  for (const BundleObservation& observation : bundle->observations) {
    const double shared[2] = {random->Gaussian(common), random->Gaussian(common)};
    for (int n = 0; n < count; ++n) {
      replicates.push_back(observation);
      for (size_t r = 0; r < 2; ++r) {
        replicates.back().seen.values[r] += shared[r] + random->Gaussian(own);
      }
    }
  }
  bundle->observations = replicates;
}

TEST(CameraNoise, CorrectsSigmasThatAreWrongByAFactor) {
  for (const double wrong : {0.3, 1.0, 4.0}) {
    Bundle bundle = ExactBundle(10);
    Random random(1);
    AddNoise(
        &random, [](size_t) { return 0.2; }, &bundle);
    AssumeSigmas(0.2 / wrong, &bundle);
    const NoiseModel noise = EstimateCameraNoise(bundle, 0, {});
    EXPECT_NEAR(noise.detector_scale, wrong, kTolerance * wrong);
    EXPECT_EQ(noise.additive_sigma, 0) << "equal sigmas cannot separate it";
    EXPECT_EQ(noise.common_sigma, 0);
    EXPECT_NEAR(noise.Sigma(0.2 / wrong), 0.2, kTolerance * 0.2);
  }
}

TEST(CameraNoise, IsThatOfTheUsedObservationsOfTheCamera) {
  Bundle bundle = TrueBundle(MakeProblem(3, {.cameras = 2, .frames = 10}));
  Random random(1);
  AddNoise(
      &random, [](size_t) { return 0.2; }, &bundle);
  AssumeSigmas(0.2, &bundle);
  const double before = EstimateCameraNoise(bundle, 0, {}).detector_scale;
  size_t i = 0, unused = 0;
  for (BundleObservation& observation : bundle.observations) {
    if (observation.camera == 1) observation.seen.values[0] += 7;
    if (observation.camera != 0 || ++i % 10 != 0) continue;
    observation.seen.values[1] += 100;
    observation.used = false;
    ++unused;
  }
  ASSERT_GT(unused, 20U);
  EXPECT_NEAR(EstimateCameraNoise(bundle, 0, {}).detector_scale, before, 0.5 * kTolerance);
  EXPECT_GT(EstimateCameraNoise(bundle, 1, {}).detector_scale, 20);
}

TEST(CameraNoise, SeparatesAnAdditiveErrorWhereSigmasDiffer) {
  Bundle bundle = ExactBundle(20);
  const auto assumed = [](size_t i) { return i % 2 == 0 ? 0.05 : 0.5; };
  Random random(2);
  AddNoise(
      &random, [&](size_t i) { return std::hypot(0.8 * assumed(i), 0.2); }, &bundle);
  for (size_t i = 0; i < bundle.observations.size(); ++i) {
    bundle.observations[i].assumed_sigma = assumed(i);
  }
  const NoiseModel noise = EstimateCameraNoise(bundle, 0, {});
  EXPECT_NEAR(noise.detector_scale, 0.8, kTolerance * 0.8);
  EXPECT_NEAR(noise.additive_sigma, 0.2, kTolerance * 0.2);
}

TEST(CameraNoise, SeparatesTheErrorThatReplicatesShare) {
  constexpr double kOwn = 0.1;
  for (const double common : {0.0, 0.3}) {
    Bundle bundle = ExactBundle(10);
    Random random(3);
    Replicate(5, common, kOwn, &random, &bundle);
    AssumeSigmas(kOwn, &bundle);
    const NoiseModel noise = EstimateCameraNoise(bundle, 0, {});
    EXPECT_NEAR(noise.OwnSigma(kOwn), kOwn, kTolerance * kOwn);
    // Without common noise the estimate is zero or drowns in that of the means, 0.1 / sqrt(5).
    EXPECT_NEAR(noise.common_sigma, common, common > 0 ? kTolerance * common : 0.3 * kOwn);
  }
}

TEST(CameraNoise, IsOneForAllWhereFewMarkersAreReplicated) {
  constexpr double kOwn = 0.1;
  Bundle bundle = ExactBundle(1);
  bundle.observations.resize(20);
  Random random(3);
  Replicate(10, 0.3, kOwn, &random, &bundle);
  AssumeSigmas(kOwn, &bundle);
  const NoiseModel noise = EstimateCameraNoise(bundle, 0, {});
  EXPECT_EQ(noise.common_sigma, 0);
  double squares = 0;
  const Bundle exact = ExactBundle(1);
  for (size_t i = 0; i < bundle.observations.size(); ++i) {
    for (size_t r = 0; r < 2; ++r) {
      squares += std::pow(
          bundle.observations[i].seen.values[r] - exact.observations[i / 10].seen.values[r], 2);
    }
  }
  const double rms = std::sqrt(squares / (2 * static_cast<double>(bundle.observations.size())));
  EXPECT_NEAR(noise.Sigma(kOwn), rms, 1e-6);
}

TEST(CameraNoise, CountsOnlyTheDegreesThatUnknownsHaveLeft) {
  Bundle bundle = ExactBundle(10);
  Random random(4);
  AddNoise(
      &random, [](size_t) { return 0.2; }, &bundle);
  AssumeSigmas(0.2, &bundle);
  const double coordinates = UsedCoordinates(bundle)[0];
  EXPECT_EQ(coordinates, 2 * static_cast<double>(bundle.observations.size()));
  const double all = EstimateCameraNoise(bundle, 0, {}).Sigma(0.2);
  // The same squares on a quarter of the coordinates: twice the sigma.
  const double used = 0.75 * coordinates;
  EXPECT_NEAR(EstimateCameraNoise(bundle, 0, {used, used}).Sigma(0.2) / all, 2, 1e-9);
}

TEST(CameraNoise, OfASigmaIsThatSigmaOfATypicalObservation) {
  for (const double sigma : {1e-12, 0.01, 0.1, 3.0}) {
    const NoiseModel noise = NoiseOfSigma(sigma, 0.1);
    EXPECT_NEAR(noise.Sigma(0.1), std::max(sigma, kSmallestNoise), 1e-12 + 1e-9 * sigma);
    EXPECT_LE(noise.detector_scale, 1);
  }
}

TEST(CameraNoise, RobustEstimateWithstandsOutliers) {
  Bundle bundle = ExactBundle(20);
  Random random(5);
  AddNoise(
      &random, [](size_t i) { return i % 10 == 0 ? 50.0 : 0.2; }, &bundle);
  AssumeSigmas(0.1, &bundle);
  const std::vector<bool> all(bundle.T_rig_target.size(), true);
  const std::vector<double> typical{0.1};
  EXPECT_TRUE(EstimateNoiseRobustly(all, typical, &bundle).empty());
  // A tenth of outliers moves the median of the others' lengths to the quantile 0.5 / 0.9: 1.27
  // in place of 1.18 sigma.
  EXPECT_NEAR(bundle.cameras[0].noise.Sigma(0.1), 0.2 * 1.27 / 1.18, kTolerance * 0.2);
}

TEST(CameraNoise, RobustEstimateNamesCamerasWhoseModelImagesTooLittle) {
  Bundle bundle = ExactBundle(3);
  for (RigidTransform& T : bundle.T_rig_target) T.t.z() = -5;  // behind the camera
  const std::vector<double> typical{0.1};
  const std::vector<size_t> outside =
      EstimateNoiseRobustly(std::vector<bool>(3, true), typical, &bundle);
  EXPECT_EQ(outside, std::vector<size_t>{0});
}

}  // namespace TEST_FILE
}  // namespace plenocal
