// SPDX-License-Identifier: Apache-2.0
//
// Noise from replicates of a known relation: all observations of a marker in a view have one value,
// their mean, so that residuals and redundancies are those of a sample mean.
#include "calib/noise/replicate_noise.h"

#include <gtest/gtest.h>

#include <cmath>

#include "models/registry.h"
#include "tests/calib/random.h"

namespace plenocal {
namespace TEST_FILE {

using testing::Random;

void FitMean(std::span<const Observation* const> of_marker,
             std::span<const double> weights,
             ReplicateResidual* residuals) {
  double sum = 0;
  Eigen::Vector2d mean(0, 0);
  for (size_t i = 0; i < of_marker.size(); ++i) {
    sum += weights[i];
    mean += weights[i] * Eigen::Vector2d(of_marker[i]->values[0], of_marker[i]->values[1]);
  }
  mean /= sum;
  for (size_t i = 0; i < of_marker.size(); ++i) {
    const Eigen::Vector2d value(of_marker[i]->values[0], of_marker[i]->values[1]);
    residuals[i] = {(value - mean).squaredNorm(), 2 - 2 * weights[i] / sum};
  }
}

// `markers` markers, each seen `count` times at a random position, with sigmas by lens type.
View SeenMarkers(int markers, int count, const std::vector<double>& sigmas, Random* random) {
  View view{"0", {}};
  for (int marker = 0; marker < markers; ++marker) {
    const double x = random->Uniform(0, 1000), y = random->Uniform(0, 1000);
    for (int n = 0; n < count; ++n) {
      const int type = n % static_cast<int>(sigmas.size());
      const double sigma = sigmas[static_cast<size_t>(type)];
      Observation seen{.marker = marker, .lens_type = type};
      seen.values = {x + random->Gaussian(sigma), y + random->Gaussian(sigma)};
      view.observations.push_back(seen);
    }
  }
  return view;
}

TEST(ReplicateNoise, GroupsObservationsByMarker) {
  Random random(1);
  const View view = SeenMarkers(7, 4, {0.1}, &random);
  std::vector<Replicates> replicates;
  AddReplicates(view.observations, &replicates);
  ASSERT_EQ(replicates.size(), 7U);
  for (const Replicates& of_marker : replicates) {
    EXPECT_EQ(of_marker.size(), 4U);
    for (const Observation* seen : of_marker) EXPECT_EQ(seen->marker, of_marker[0]->marker);
  }
}

TEST(ReplicateNoise, IsThatOfEachLensType) {
  Random random(2);
  const std::vector<double> sigmas{0.1, 0.3, 0.05};
  const View view = SeenMarkers(500, 9, sigmas, &random);
  std::vector<Replicates> replicates;
  AddReplicates(view.observations, &replicates);
  const std::map<int, LensTypeNoise> noise = NoiseByLensType(replicates, &FitMean);
  ASSERT_EQ(noise.size(), 3U);
  double redundancy = 0;
  for (const auto& [type, of_type] : noise) {
    // 3000 coordinates of each type: 1.3 %.
    EXPECT_NEAR(of_type.sigma / sigmas[static_cast<size_t>(type)], 1, 0.06) << type;
    redundancy += of_type.redundancy;
  }
  // Nine observations of two coordinates less one mean, for each marker.
  EXPECT_NEAR(redundancy, 500 * (2 * 9 - 2), 1e-6);
}

TEST(ReplicateNoise, IgnoresOutliers) {
  Random random(3);
  View view = SeenMarkers(500, 8, {0.1}, &random);
  for (size_t i = 0; i < view.observations.size(); i += 40) view.observations[i].values[0] += 20;
  std::vector<Replicates> replicates;
  AddReplicates(view.observations, &replicates);
  const std::map<int, LensTypeNoise> noise = NoiseByLensType(replicates, &FitMean);
  // A fifth of the markers has an outlier, which spoils their mean and with it all of them.
  EXPECT_NEAR(noise.at(0).sigma, 0.1, 0.006);
}

TEST(ReplicateNoise, LeavesOutTypesWithoutRedundancy) {
  Random random(4);
  const View view = SeenMarkers(50, 1, {0.1}, &random);
  std::vector<Replicates> replicates;
  AddReplicates(view.observations, &replicates);
  EXPECT_TRUE(NoiseByLensType(replicates, &FitMean).empty());
}

TEST(NoiseFloor, IsTheSpreadOfReplicatesAndCountsTheIncludedOnly) {
  CameraModel model = *FindModel(CameraModels(), "pinhole-radial3");
  Bundle bundle;
  bundle.cameras.push_back(
      {.model = &model, .config = {}, .params = {}, .fixed = {}, .T_camera_rig = {}});
  // Two markers: x = 0 and 2 about their mean 1, and one that is left out; the other 0, 0, 3.
  for (const auto& [marker, x, used] : {std::tuple{0, 0.0, true},
                                        {0, 2.0, true},
                                        {0, 77.0, false},
                                        {1, 0.0, true},
                                        {1, 0.0, true},
                                        {1, 3.0, true}}) {
    Observation seen{.marker = marker};
    seen.values = {x, 5};
    bundle.observations.push_back({0, 0, marker, seen, used});
  }
  const auto include = [](const BundleObservation& observation) { return observation.used; };
  EXPECT_EQ(EstimateNoiseFloor(bundle, 0, include).redundancy, 0) << "no replicate fit";
  model.replicate_fit = &FitMean;
  const NoiseFloor floor = EstimateNoiseFloor(bundle, 0, include);
  EXPECT_NEAR(floor.redundancy, 2 * (2 - 1) + 2 * (3 - 1), 1e-12);
  EXPECT_NEAR(floor.coordinate, std::sqrt(8.0 / 6), 1e-12);
  EXPECT_NEAR(floor.length, std::sqrt(2 * 8.0 / 6), 1e-12);
}

}  // namespace TEST_FILE
}  // namespace plenocal
