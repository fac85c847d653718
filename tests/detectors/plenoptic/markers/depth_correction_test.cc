// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/depth_correction.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/detectors/plenoptic/markers/simulated_measurements.h"

namespace plenocal::internal {
namespace {

/// Measured with drawings whose ln v is too small by `common` at 1 / v = 0.25, by twice that at
/// 0.35, and, by marker, by a random part.
struct Scene {
  std::vector<RawMeasurements> measured, right;

  Scene(double common, double scatter) {
    const auto make = [&](bool wrong) {
      std::mt19937 engine(3);
      std::normal_distribution<double> normal;
      int marker = -1;
      double growth = 0;
      return SimulateMeasurements(3, [&](const Eigen::Vector2d& offset, MarkerMeasurement* o) {
        // The side towards the micro image's centre is seen farther.
        o->depth_sensitivity = -0.12 * offset * (1 + 0.02 * offset.norm());
        if (o->observation.marker != marker) {
          growth = common * (1 + (o->inverse_depth - 0.25) / 0.1) + scatter * normal(engine);
          marker = o->observation.marker;
        }
        if (!wrong) return;
        o->Move(-growth * o->depth_sensitivity);
        o->inverse_depth *= std::exp(growth);
      });
    };
    measured = make(true);
    right = make(false);
  }
};

TEST(CorrectDepthBias, FindsWhatAllMarkersHaveInCommon) {
  Scene scene(0.01, 0);
  const double before = Difference(scene.measured, scene.right);
  EXPECT_GT(before, 0.01);
  CorrectDepthBias(&scene.measured);
  EXPECT_LT(Difference(scene.measured, scene.right), before / 20);
}

TEST(CorrectDepthBias, LeavesWhatIsOneMarkersOwn) {
  Scene scene(0, 0.003);
  const Scene before = scene;
  CorrectDepthBias(&scene.measured);
  EXPECT_LT(Difference(scene.measured, before.measured), 0.0005);
}

TEST(CorrectDepthBias, IsNotMovedByAWrongMarker) {
  Scene scene(0.01, 0);
  const double before = Difference(scene.measured, scene.right);
  for (size_t v = 0; v < scene.measured.size(); v += 2) {
    for (size_t i = 0; i < scene.measured[v].size() && scene.measured[v][i].observation.marker == 0;
         ++i) {
      const Eigen::Vector2d push =
          0.2 * (scene.measured[v][i].Position() - scene.measured[v][i].Centre());
      scene.measured[v][i].Move(push);
      scene.right[v][i].Move(push);
    }
  }
  CorrectDepthBias(&scene.measured);
  EXPECT_LT(Difference(scene.measured, scene.right), before / 10);
}

TEST(CorrectDepthBias, AcceptsAnEmptySetAndOneOfASingleMicroImage) {
  std::vector<RawMeasurements> none;
  CorrectDepthBias(&none);
  EXPECT_TRUE(none.empty());
  const Scene scene(0.01, 0);
  std::vector<RawMeasurements> one{{scene.measured[0][0]}};
  CorrectDepthBias(&one);
  EXPECT_EQ(one[0][0].Position(), scene.measured[0][0].Position());
}

}  // namespace
}  // namespace plenocal::internal
