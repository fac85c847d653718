// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/jackknife.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "calib/adjust/solver/adjust.h"
#include "calib/base/error.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

constexpr int kFrames = 7;

// A calibrated pair, whose principal point is given.
Bundle CalibratedPair() {
  Bundle bundle =
      testing::TrueBundle(testing::MakeProblem(7, {.cameras = 2, .frames = kFrames, .noise = 0.2}));
  for (BundleObservation& observation : bundle.observations) observation.assumed_sigma = 0.2;
  bundle.cameras[0].fixed[2] = true;
  EXPECT_TRUE(Adjust(&bundle, {}).usable);
  return bundle;
}

// The bundle without frames, adjusted.
Bundle Without(const Bundle& bundle, int first, int end) {
  Bundle rest = bundle;
  for (BundleObservation& observation : rest.observations) {
    if (observation.frame >= first && observation.frame < end) observation.used = false;
  }
  AdjustOptions options;
  options.loss = Loss::kHuber;
  options.cost_tolerance = 1e-9;
  EXPECT_TRUE(Adjust(&rest, options).usable);
  return rest;
}

// sqrt((G - 1) / G sum (x - mean)^2).
double StandardError(const std::vector<double>& x) {
  double mean = 0, squares = 0;
  const auto count = static_cast<double>(x.size());
  for (const double each : x) mean += each / count;
  for (const double each : x) squares += (each - mean) * (each - mean);
  return std::sqrt((count - 1) / count * squares);
}

TEST(Jackknife, IsTheScatterOfCalibrationsWithoutSuccessiveFrames) {
  const Bundle bundle = CalibratedPair();
  const Jackknife jackknife =
      EstimateByJackknife(bundle, {.groups = 3, .threads = 1, .progress = {}});
  EXPECT_EQ(jackknife.groups, 3);
  const std::vector<Bundle> rests{
      Without(bundle, 0, 3), Without(bundle, 3, 5), Without(bundle, 5, 7)};
  for (size_t c = 0; c < 2; ++c) {
    for (size_t k = 0; k < 7; ++k) {
      std::vector<double> values;
      for (const Bundle& rest : rests) values.push_back(rest.cameras[c].params[k]);
      const double expected = StandardError(values);
      EXPECT_NEAR(jackknife.param_std_errors[c][k], expected, 1e-3 * expected) << c << " " << k;
    }
  }
  EXPECT_EQ(jackknife.param_std_errors[0][2], 0);
  EXPECT_GT(jackknife.param_std_errors[1][2], 0);
  EXPECT_TRUE(jackknife.extrinsics_std_errors[0].isZero(0));
  for (Eigen::Index i = 0; i < 6; ++i) {
    std::vector<double> values;
    for (const Bundle& rest : rests) values.push_back(Log(rest.cameras[1].T_camera_rig)[i]);
    const double expected = StandardError(values);
    EXPECT_NEAR(jackknife.extrinsics_std_errors[1][i], expected, 1e-3 * expected) << i;
  }
}

TEST(Jackknife, HasNoMoreGroupsThanFramesWithObservations) {
  Bundle bundle = CalibratedPair();
  for (BundleObservation& observation : bundle.observations) {
    if (observation.frame == 0) observation.used = false;
  }
  std::vector<size_t> done;
  const Jackknife jackknife =
      EstimateByJackknife(bundle, {.threads = 1, .progress = [&](size_t number, size_t all) {
                                     EXPECT_EQ(all, 6U);
                                     done.push_back(number);
                                     return true;
                                   }});
  EXPECT_EQ(jackknife.groups, 6);
  EXPECT_EQ(done, (std::vector<size_t>{1, 2, 3, 4, 5, 6}));
}

TEST(Jackknife, IsInfiniteForACameraThatOneGroupSees) {
  Bundle bundle = CalibratedPair();
  for (BundleObservation& observation : bundle.observations) {
    if (observation.camera == 1 && observation.frame > 1) observation.used = false;
  }
  const Jackknife jackknife =
      EstimateByJackknife(bundle, {.groups = 2, .threads = 1, .progress = {}});
  EXPECT_TRUE(std::isfinite(jackknife.param_std_errors[0][0]));
  EXPECT_TRUE(std::isinf(jackknife.param_std_errors[1][0]));
  EXPECT_TRUE(std::isinf(jackknife.extrinsics_std_errors[1][0]));
}

TEST(Jackknife, NeedsTwoFramesAndStops) {
  const Bundle bundle = CalibratedPair();
  EXPECT_THROW((void)EstimateByJackknife(
                   bundle, {.threads = 1, .progress = [](size_t, size_t) { return false; }}),
               Stopped);
  Bundle single = bundle;
  for (BundleObservation& observation : single.observations) {
    observation.used = observation.frame == 2;
  }
  EXPECT_THROW((void)EstimateByJackknife(single, {}), Error);
}

}  // namespace TEST_FILE
}  // namespace plenocal
