// SPDX-License-Identifier: Apache-2.0
#include "detectors/depth_shift.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/detectors/micro_views.h"

namespace plenocal::internal {
namespace {

/// Measured with drawings whose ln v is too small by `common` at 1 / v = 0.25, by twice that at
/// 0.35, and, by marker, by a random part.
struct Scene {
  std::vector<MicroView> measured, right;

  Scene(double common, double scatter) {
    const auto make = [&](bool wrong) {
      std::mt19937 engine(3);
      std::normal_distribution<double> normal;
      int marker = -1;
      double growth = 0;
      return MakeMicroViews(3, [&](const Eigen::Vector2d& offset, MicroObservation* o) {
        // The side towards the micro image's centre is seen farther.
        o->by_depth = -0.12 * offset * (1 + 0.02 * offset.norm());
        if (o->seen.marker != marker) {
          growth = common * (1 + (o->inverse_depth - 0.25) / 0.1) + scatter * normal(engine);
          marker = o->seen.marker;
        }
        if (!wrong) return;
        o->Move(-growth * o->by_depth);
        o->inverse_depth *= std::exp(growth);
      });
    };
    measured = make(true);
    right = make(false);
  }
};

TEST(RemoveDepthShifts, FindsWhatAllMarkersHaveInCommon) {
  Scene scene(0.01, 0);
  const double before = Difference(scene.measured, scene.right);
  EXPECT_GT(before, 0.01);
  RemoveDepthShifts(&scene.measured);
  EXPECT_LT(Difference(scene.measured, scene.right), before / 20);
}

TEST(RemoveDepthShifts, LeavesWhatIsOneMarkersOwn) {
  Scene scene(0, 0.003);
  const Scene before = scene;
  RemoveDepthShifts(&scene.measured);
  EXPECT_LT(Difference(scene.measured, before.measured), 0.0005);
}

TEST(RemoveDepthShifts, IsNotMovedByAWrongMarker) {
  Scene scene(0.01, 0);
  const double before = Difference(scene.measured, scene.right);
  for (size_t v = 0; v < scene.measured.size(); v += 2) {
    for (size_t i = 0; i < scene.measured[v].size() && scene.measured[v][i].seen.marker == 0; ++i) {
      const Eigen::Vector2d push =
          0.2 * (scene.measured[v][i].Place() - scene.measured[v][i].Centre());
      scene.measured[v][i].Move(push);
      scene.right[v][i].Move(push);
    }
  }
  RemoveDepthShifts(&scene.measured);
  EXPECT_LT(Difference(scene.measured, scene.right), before / 10);
}

TEST(RemoveDepthShifts, AcceptsAnEmptySetAndOneOfASingleMicroImage) {
  std::vector<MicroView> none;
  RemoveDepthShifts(&none);
  EXPECT_TRUE(none.empty());
  const Scene scene(0.01, 0);
  std::vector<MicroView> one{{scene.measured[0][0]}};
  RemoveDepthShifts(&one);
  EXPECT_EQ(one[0][0].Place(), scene.measured[0][0].Place());
}

}  // namespace
}  // namespace plenocal::internal
