// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/common_errors.h"

#include <gtest/gtest.h>

#include <cmath>

#include "calib/adjust/problem.h"
#include "calib/base/statistics.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace {

using testing::MakeProblem;
using testing::Random;
using testing::TrueBundle;

constexpr double kNoise = 0.1;  // px
enum { kFx, kFy, kCx, kCy };

// Noisy observations; in each frame, the lens has a radial distortion of its own, a factor of
// standard deviation `stretch` on the square of the radius, 1 / px^2, which no pose can absorb.
Bundle AdjustedBundle(unsigned seed, double stretch) {
  Bundle bundle = TrueBundle(MakeProblem(seed, {.frames = 20, .noise = kNoise}));
  Random random(seed);
  std::vector<double> factors;
  for (size_t f = 0; f < bundle.T_rig_target.size(); ++f)
    factors.push_back(random.Gaussian(stretch));
  for (BundleObservation& observation : bundle.observations) {
    std::array<double, kMaxObservationSize>& values = observation.seen.values;
    const double x = values[0] - 640, y = values[1] - 480;
    const double factor = factors[static_cast<size_t>(observation.frame)] * (x * x + y * y);
    values[0] += x * factor;
    values[1] += y * factor;
  }
  AdjustOptions options;
  EXPECT_TRUE(Adjust(&bundle, options).usable);
  return bundle;
}

TEST(CommonErrors, OfIndependentNoiseAreNone) {
  // The sum of several factors' degrees of freedom times themselves is chi-square distributed.
  double squares = 0, degrees = 0;
  for (unsigned seed = 0; seed < 4; ++seed) {
    const Bundle bundle = AdjustedBundle(seed, 0);
    const CommonErrors errors = EstimateCommonErrors(bundle, EstimateUncertainty(bundle));
    ASSERT_EQ(errors.scatter.size(), 1U);
    EXPECT_GT(errors.scatter[0].degrees, 10);
    squares += errors.scatter[0].factor * errors.scatter[0].degrees;
    degrees += errors.scatter[0].degrees;
    EXPECT_TRUE(errors.shared.isZero());
  }
  const double tail = ChiSquareTail(static_cast<int>(std::lround(degrees)), squares);
  EXPECT_GT(tail, 1e-3);
  EXPECT_LT(tail, 1 - 1e-3);
}

TEST(CommonErrors, OfFramesWithADistortionOfTheirOwnAreFound) {
  const Bundle bundle = AdjustedBundle(5, 5e-9);  // a pixel at the image's edge
  const CommonErrors errors = EstimateCommonErrors(bundle, EstimateUncertainty(bundle));
  const double rest = 2.0 * static_cast<double>(bundle.observations.size());
  EXPECT_LT(FTail(errors.scatter[0].factor, errors.scatter[0].degrees, rest), 1e-6);
}

// An error that moves all points of a camera alike is a shift of its principal point, and of
// nothing else: its variance joins that of c_x and c_y.
TEST(CommonErrors, OfAllPointsAddTheirVarianceToTheParametersThatFollowThem) {
  Bundle bundle = AdjustedBundle(6, 0);
  constexpr double kAlongX = 0.4, kAlongY = -0.3;  // px, for one standard deviation
  for (BundleObservation& observation : bundle.observations) {
    observation.shared_errors = {kAlongX, kAlongY};  // two coordinates of one error
  }
  Uncertainty uncertainty = EstimateUncertainty(bundle);
  const Uncertainty before = uncertainty;
  const CommonErrors errors = EstimateCommonErrors(bundle, uncertainty);
  const double tolerance = 1e-4;
  EXPECT_NEAR(errors.shared(kCx, kCx), kAlongX * kAlongX, tolerance);
  EXPECT_NEAR(errors.shared(kCy, kCy), kAlongY * kAlongY, tolerance);
  EXPECT_NEAR(errors.shared(kCx, kCy), kAlongX * kAlongY, tolerance);
  EXPECT_NEAR(errors.shared(kFx, kFx), 0, tolerance);

  AddCommonErrors({4.0}, errors.shared, &uncertainty);
  const auto variance = [](const Uncertainty& of, size_t k) {
    return std::pow(of.param_std_errors[0][k], 2);
  };
  EXPECT_NEAR(variance(uncertainty, kFx) / variance(before, kFx), 4, 1e-3);
  EXPECT_NEAR(variance(uncertainty, kCx), 4 * variance(before, kCx) + kAlongX * kAlongX, tolerance);
  for (Eigen::Index i = 0; i < uncertainty.correlation.rows(); ++i) {
    EXPECT_NEAR(uncertainty.correlation(i, i), 1, 1e-12);
  }
}

}  // namespace
}  // namespace plenocal
