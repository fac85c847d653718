// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/frame_scatter.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "calib/adjust/solver/adjust.h"
#include "calib/base/statistics.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

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

TEST(FrameScatter, OfIndependentNoiseIsNone) {
  // The sum of several factors' degrees of freedom times themselves is chi-square distributed.
  double squares = 0, degrees = 0;
  for (unsigned seed = 0; seed < 4; ++seed) {
    const Bundle bundle = AdjustedBundle(seed, 0);
    const auto scatter = EstimateScatter(bundle, EstimateUncertainty(bundle)).of_frames;
    ASSERT_EQ(scatter.size(), 1U);
    EXPECT_GT(scatter[0].degrees, 10);
    squares += scatter[0].factor * scatter[0].degrees;
    degrees += scatter[0].degrees;
  }
  const double tail = ChiSquareTail(static_cast<int>(std::lround(degrees)), squares);
  EXPECT_GT(tail, 1e-3);
  EXPECT_LT(tail, 1 - 1e-3);
}

TEST(FrameScatter, OfFramesWithADistortionOfTheirOwnIsFound) {
  const Bundle bundle = AdjustedBundle(5, 5e-9);  // a pixel at the image's edge
  const auto scatter = EstimateScatter(bundle, EstimateUncertainty(bundle)).of_frames;
  const double rest = 2.0 * static_cast<double>(bundle.observations.size());
  EXPECT_LT(FTail(scatter[0].factor, scatter[0].degrees, rest), 1e-6);
}

// Noisy observations; each marker is seen beside its place by the same random pixels in all frames.
Bundle BundleOfDisplacedMarkers(unsigned seed, double displacement) {
  Bundle bundle = TrueBundle(MakeProblem(seed, {.frames = 20, .noise = kNoise}));
  Random random(seed + 100);
  std::vector<Eigen::Vector2d> moved;
  for (size_t m = 0; m < bundle.markers.size(); ++m) {
    moved.push_back(random.Gaussians<2>(displacement));
  }
  for (BundleObservation& observation : bundle.observations) {
    for (size_t r = 0; r < 2; ++r) {
      observation.seen.values[r] +=
          moved[static_cast<size_t>(observation.marker)][static_cast<Eigen::Index>(r)];
    }
  }
  EXPECT_TRUE(Adjust(&bundle, AdjustOptions()).usable);
  return bundle;
}

TEST(MarkerScatter, OfIndependentNoiseIsNone) {
  double squares = 0, degrees = 0;
  for (unsigned seed = 0; seed < 4; ++seed) {
    const Bundle bundle = BundleOfDisplacedMarkers(seed, 0);
    const Scatter scatter = EstimateScatter(bundle, EstimateUncertainty(bundle)).of_markers[0];
    EXPECT_GT(scatter.degrees, 10);
    squares += scatter.factor * scatter.degrees;
    degrees += scatter.degrees;
  }
  const double tail = ChiSquareTail(static_cast<int>(std::lround(degrees)), squares);
  EXPECT_GT(tail, 1e-3);
  EXPECT_LT(tail, 1 - 1e-3);
}

// More unknowns than directions are looked at: rows of the target as targets of their own.
TEST(MarkerScatter, OfIndependentNoiseIsNoneForManyUnknowns) {
  double squares = 0, degrees = 0;
  for (unsigned seed = 0; seed < 4; ++seed) {
    Bundle bundle = TrueBundle(
        MakeProblem(seed, {.shape = testing::TargetShape::kCorner, .frames = 20, .noise = kNoise}));
    std::map<int, int> targets;
    for (BundleMarker& marker : bundle.markers) {
      marker.target =
          targets.try_emplace(marker.number / 30, static_cast<int>(targets.size())).first->second;
    }
    for (size_t k = 0; k < targets.size(); ++k)
      bundle.targets.push_back({.name = {}, .T_target_own = {}, .is_fixed = k == 0});
    ASSERT_TRUE(Adjust(&bundle, AdjustOptions()).usable);
    const Uncertainty uncertainty = EstimateUncertainty(bundle);
    ASSERT_GT(uncertainty.covariance.rows(), 40);
    const Scatter scatter = EstimateScatter(bundle, uncertainty).of_markers[0];
    EXPECT_GT(scatter.degrees, 10);
    squares += scatter.factor * scatter.degrees;
    degrees += scatter.degrees;
  }
  const double tail = ChiSquareTail(static_cast<int>(std::lround(degrees)), squares);
  EXPECT_GT(tail, 1e-3);
  EXPECT_LT(tail, 1 - 1e-3);
}

TEST(MarkerScatter, OfMarkersThatOneCameraSeesBesideTheirPlaceIsFound) {
  const Bundle bundle = BundleOfDisplacedMarkers(5, kNoise);
  const Scatter scatter = EstimateScatter(bundle, EstimateUncertainty(bundle)).of_markers[0];
  const double rest = 2.0 * static_cast<double>(bundle.observations.size());
  EXPECT_LT(FTail(scatter.factor, scatter.degrees, rest), 1e-6);
}

TEST(FrameScatter, ScalesVariances) {
  const Bundle bundle = AdjustedBundle(6, 0);
  Uncertainty uncertainty = EstimateUncertainty(bundle);
  const Uncertainty before = uncertainty;
  ScaleByScatter({4.0}, &uncertainty);
  for (const size_t k : {kFx, kCx}) {
    EXPECT_NEAR(uncertainty.param_std_errors[0][k], 2 * before.param_std_errors[0][k], 1e-9);
  }
  for (Eigen::Index i = 0; i < uncertainty.correlation.rows(); ++i) {
    EXPECT_NEAR(uncertainty.correlation(i, i), 1, 1e-12);
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
