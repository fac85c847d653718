// SPDX-License-Identifier: Apache-2.0
//
// Each back end by itself: what it reports, where it ends, and problems with unknowns of one kind.
#include "calib/adjust/all_unknowns/minimise.h"

#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "calib/adjust/reduced/minimise.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

using testing::MakeProblem;
using testing::TrueBundle;

Vector6d Motion(double size) {
  Vector6d motion;
  motion << 0.1, -0.05, 0.08, 1, -0.7, 0.8;
  return size * motion;
}

// A pair near its optimum, parameters and poses a little off.
Bundle Disturbed(double noise = 0.2) {
  Bundle bundle = TrueBundle(MakeProblem(5, {.cameras = 2, .frames = 4, .noise = noise}));
  for (BundleCamera& camera : bundle.cameras) camera.params[0] *= 1.02;
  for (RigidTransform& T : bundle.T_rig_target) T = Retract(T, Motion(0.02));
  return bundle;
}

double Cost(const Bundle& bundle) {
  double sum = 0;
  for (const double length : WeightedLengths(bundle)) sum += length * length;
  return sum / 2;
}

class BackEnd : public ::testing::TestWithParam<bool> {
 protected:
  static AdjustSummary Minimise(const AdjustOptions& options, Bundle* bundle) {
    return GetParam() ? internal::MinimiseReduced(options, bundle)
                      : internal::MinimiseAllUnknowns(options, bundle);
  }
};

INSTANTIATE_TEST_SUITE_P(Alone, BackEnd, ::testing::Bool(), [](const auto& test) {
  return test.param ? "Reduced" : "AllUnknowns";
});

TEST_P(BackEnd, ReportsTheCostsBeforeAndAfter) {
  Bundle bundle = Disturbed();
  for (BundleCamera& camera : bundle.cameras) camera.at_bound.assign(7, true);  // of an earlier one
  const double before = Cost(bundle);
  const AdjustSummary summary = Minimise({}, &bundle);
  EXPECT_TRUE(summary.usable);
  EXPECT_TRUE(summary.converged);
  EXPECT_FALSE(summary.stopped);
  EXPECT_NEAR(summary.cost_before / before, 1, 1e-10);
  EXPECT_NEAR(summary.cost / Cost(bundle), 1, 1e-8);
  EXPECT_LT(summary.cost, 1e-2 * before);
  EXPECT_GE(summary.iterations, 3);
  EXPECT_LE(summary.iterations, 12);
  EXPECT_FALSE(summary.message.empty());
  EXPECT_THAT(bundle.cameras[0].at_bound, ::testing::IsEmpty());
}

TEST_P(BackEnd, EndsAfterTheMostIterations) {
  double last = Cost(Disturbed());
  for (const int most : {1, 2}) {
    Bundle bundle = Disturbed();
    AdjustOptions options;
    options.max_iterations = most;
    const AdjustSummary summary = Minimise(options, &bundle);
    EXPECT_TRUE(summary.usable);
    EXPECT_FALSE(summary.converged);
    EXPECT_FALSE(summary.stopped);
    EXPECT_EQ(summary.iterations, most + 1);
    EXPECT_NEAR(summary.cost / Cost(bundle), 1, 1e-10);
    EXPECT_LT(summary.cost, last);
    EXPECT_FALSE(summary.message.empty());
    last = summary.cost;
  }
}

TEST_P(BackEnd, LeavesTheBundleWhereItIsStopped) {
  Bundle bundle = Disturbed();
  bundle.cameras[0].at_bound.assign(7, false);
  bundle.cameras[0].at_bound[3] = true;
  const Bundle before = bundle;
  AdjustOptions options;
  options.on_iteration = [](int iteration, double /*cost*/) { return iteration < 2; };
  const AdjustSummary summary = Minimise(options, &bundle);
  EXPECT_FALSE(summary.usable);
  EXPECT_FALSE(summary.converged);
  EXPECT_TRUE(summary.stopped);
  EXPECT_FALSE(summary.message.empty());
  EXPECT_EQ(bundle.cameras[1].params, before.cameras[1].params);
  EXPECT_EQ(bundle.cameras[0].at_bound, before.cameras[0].at_bound);
  EXPECT_EQ(bundle.T_rig_target[2].t, before.T_rig_target[2].t);
}

TEST_P(BackEnd, RefusesAStartOutsideOfTheDomain) {
  Bundle bundle = Disturbed();
  bundle.T_rig_target[1].t.z() = -3;
  bundle.cameras[0].at_bound.assign(7, false);
  const Bundle before = bundle;
  const AdjustSummary summary = Minimise({}, &bundle);
  EXPECT_FALSE(summary.usable);
  EXPECT_FALSE(summary.converged);
  EXPECT_FALSE(summary.message.empty());
  EXPECT_EQ(bundle.cameras[0].params, before.cameras[0].params);
  EXPECT_EQ(bundle.cameras[0].at_bound, before.cameras[0].at_bound);
  EXPECT_EQ(bundle.T_rig_target[1].t, before.T_rig_target[1].t);
}

// Exact observations of poses and unknowns of one more kind, which are the first of all.
struct Kind {
  std::string name;
  std::function<void(Bundle*)> disturb;
  std::function<double(const Bundle&)> error;
};

const std::vector<Kind>& Kinds() {
  static const Bundle truth = TrueBundle(MakeProblem(5, {.cameras = 2, .frames = 3}));
  static const RigidTransform board{ExpRotation({0.3, 0.2, -0.1}), {0.1, 0.05, 0.02}};
  static const std::vector<Kind> kinds{
      {"Extrinsics",
       [](Bundle* bundle) {
         BundleCamera& camera = bundle->cameras[1];
         camera.is_master = false;
         camera.T_camera_rig = Retract(camera.T_camera_rig, Motion(0.2));
       },
       [](const Bundle& bundle) {
         return LocalCoordinates(bundle.cameras[1].T_camera_rig, truth.cameras[1].T_camera_rig)
             .norm();
       }},
      {"Target",
       [](Bundle* bundle) {
         bundle->targets = {{"wall", {}, true}, {"board", board, false}};
         for (size_t m = 0; m < 30; ++m) bundle->markers[m].target = 1;
         MoveTarget(1, Retract(board, Motion(0.2)), bundle);
       },
       [](const Bundle& bundle) {
         return LocalCoordinates(bundle.targets[1].T_target_own, board).norm();
       }},
      {"Scales",
       [](Bundle* bundle) {
         bundle->marker_freedom = MarkerFreedom::Held();
         bundle->scales = {{.axes = Eigen::Vector3d::UnitX(), .sigma = 1e6},
                           {.axes = Eigen::Vector3d::UnitY(), .sigma = 1e6}};
         for (BundleMarker& marker : bundle->markers) {
           marker.nominal = marker.nominal.cwiseQuotient(Eigen::Vector3d(1.02, 0.97, 1));
           marker.position = marker.nominal;
         }
       },
       [](const Bundle& bundle) {
         return std::hypot(bundle.scales[0].value - 0.02, bundle.scales[1].value + 0.03);
       }},
      {"Parameter",
       [](Bundle* bundle) {
         bundle->cameras[0].fixed[1] = false;
         bundle->cameras[0].params[1] *= 1.1;
       },
       [](const Bundle& bundle) {
         return bundle.cameras[0].params[1] / truth.cameras[0].params[1] - 1;
       }}};
  return kinds;
}

TEST_P(BackEnd, FindsUnknownsOfOneKindInFewSteps) {
  for (const Kind& kind : Kinds()) {
    Bundle bundle = TrueBundle(MakeProblem(5, {.cameras = 2, .frames = 3}));
    for (BundleCamera& camera : bundle.cameras) {
      camera.is_master = true;
      camera.fixed.assign(7, true);
    }
    kind.disturb(&bundle);
    for (RigidTransform& T : bundle.T_rig_target) T = Retract(T, Motion(0.1));
    AdjustOptions options;
    options.max_iterations = 8;  // Newton's squares: wrong derivatives take more
    options.cost_tolerance = 1e-17;
    const AdjustSummary summary = Minimise(options, &bundle);
    EXPECT_TRUE(summary.usable) << kind.name << ": " << summary.message;
    EXPECT_NEAR(kind.error(bundle), 0, 1e-9) << kind.name;
  }
}

// From focal lengths that are far too long steps are too long for the poses' linear ones.
TEST(Reduced, ReachesTheOptimumFromFarInFewSteps) {
  for (const double factor : {2.0, 4.0}) {
    Bundle near = Disturbed(), far = near;
    AdjustOptions options;
    options.cost_tolerance = 1e-12;
    const double optimum = internal::MinimiseReduced(options, &near).cost;
    for (BundleCamera& camera : far.cameras) camera.params[0] *= factor;
    const AdjustSummary summary = internal::MinimiseReduced(options, &far);
    EXPECT_TRUE(summary.converged);
    EXPECT_NEAR(summary.cost / optimum, 1, 1e-6);
    EXPECT_LE(summary.iterations, 7);
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
