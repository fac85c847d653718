// SPDX-License-Identifier: Apache-2.0
//
// The adjustment that eliminates poses and markers before Ceres, against the one that gives Ceres
// all unknowns.
#include "calib/adjust/solver/reduced_cost.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <map>
#include <string>

#include "calib/adjust/elimination/frame_elimination.h"
#include "calib/adjust/solver/problem.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

using testing::MakeProblem;
using testing::TargetShape;
using testing::TrueBundle;

// A stereo pair near its optimum. Eight frames have fewer unknowns than their markers.
Bundle Stereo(int frames = 8) {
  Bundle bundle = TrueBundle(MakeProblem(5,
                                         {.shape = TargetShape::kPlane,
                                          .cameras = 2,
                                          .frames = frames,
                                          .noise = 0.2,
                                          .marker_tolerance = 0.0003}));
  bundle.observations[7].used = false;
  return bundle;
}

// Measures points where they are now seen, with the residuals that they had.
void MeasureAgain(const Bundle& before, Bundle* bundle) {
  for (size_t i = 0; i < bundle->observations.size(); ++i) {
    double had[kMaxObservationSize], has[kMaxObservationSize];
    BundleObservation& observation = bundle->observations[i];
    observation.used = observation.used && Residual(before, before.observations[i], had) &&
                       Residual(*bundle, observation, has);
    for (size_t r = 0; r < 2; ++r) observation.seen.values[r] += had[r] - has[r];
  }
}

// Makes outliers, and moves all that is estimated away from the optimum.
void Disturb(Bundle* bundle) {
  for (size_t i = 0; i < bundle->observations.size(); i += 50) {
    bundle->observations[i].seen.values[i % 2] += 3;
  }
  Vector6d delta;
  delta << 0.002, -0.003, 0.004, 0.01, -0.008, 0.006;
  for (BundleCamera& camera : bundle->cameras) {
    camera.params[0] *= 1.01;
    camera.params[2] += 3;
    if (!camera.is_master) camera.T_camera_rig = Retract(camera.T_camera_rig, delta);
  }
  for (RigidTransform& T : bundle->T_rig_target) T = Retract(T, delta = -delta);
  for (BundleMarker& marker : bundle->markers) marker.position = marker.nominal;
  for (Vector6d& jitter : bundle->jitter.delta) jitter *= -0.5;
}

void AddJitter(Bundle* bundle) {
  const Bundle before = *bundle;
  bundle->jitter.translation_sigma = 0.0005;
  bundle->jitter.rotation_sigma = 0.001;
  for (size_t view = 0; view < bundle->T_rig_target.size() * bundle->cameras.size(); ++view) {
    Vector6d delta;
    for (int i = 0; i < 6; ++i) {
      delta[i] = (i < 3 ? 0.0005 : 0.001) * std::sin(7 * static_cast<double>(view) + i);
    }
    bundle->jitter.delta.push_back(delta);
    bundle->jitter.misplaced.push_back(view == 3);
  }
  MeasureAgain(before, bundle);
}

// The second camera's images are from other times than the first one's, between which the rig
// moved.
void AddMotion(Bundle* bundle) {
  const Bundle before = *bundle;
  bundle->motion.resize(bundle->T_rig_target.size() * 2);
  for (size_t f = 0; f < bundle->T_rig_target.size(); ++f) {
    ViewMotion& motion = bundle->motion[bundle->View(f, 1)];
    const double sign = f % 2 == 0 ? 1 : -1;
    motion.at_zero_shift << 0, 0.001 * sign, 0, 0.02 * sign, 0, -0.01;
    motion.velocity << 0.5, sign, 0.1, 0.3, -0.5 * sign, 1;
  }
  BundleCamera& second = bundle->cameras[1];
  second.time_shift = second.params.size();
  second.params.push_back(0);
  second.fixed.push_back(false);
  second.rules.resize(second.params.size());
  MeasureAgain(before, bundle);
}

// A second target, which half of the markers are part of.
void AddTarget(Bundle* bundle) {
  bundle->targets.push_back({.name = "first", .T_target_own = {}, .is_fixed = true});
  RigidTransform pose;
  pose.t = {0.1, 0.2, 0.05};
  bundle->targets.push_back({.name = "second", .T_target_own = pose, .is_fixed = false});
  for (size_t m = 0; m < bundle->markers.size() / 2; ++m) bundle->markers[m].target = 1;
  pose.t.x() += 0.002;
  internal::MoveTarget(1, pose, bundle);
}

// Every marker is measured twice in a view, with an error that both measurements share.
void AddCommonNoise(Bundle* bundle) {
  std::vector<BundleObservation> twice;
  for (const BundleObservation& observation : bundle->observations) {
    twice.push_back(observation);
    twice.push_back(observation);
    twice.back().seen.values[0] += 0.1 * std::sin(static_cast<double>(twice.size()));
    twice.back().assumed_sigma = 1.5;
  }
  bundle->observations = twice;
  for (BundleCamera& camera : bundle->cameras) camera.noise.common_sigma = 0.15;
}

struct Case {
  std::string name;
  std::function<void(Bundle*)> change;
  int frames = 8;
};

const std::vector<Case>& Cases() {
  static const std::vector<Case> kCases{
      {"Rigid", [](Bundle*) {}},
      {"ManyFrames", [](Bundle*) {}, 50},
      {"ManyFramesWithJitter", AddJitter, 50},
      {"Fixed", [](Bundle* bundle) { bundle->cameras[1].fixed[2] = true; }},
      {"HeldMarkers", [](Bundle* bundle) { bundle->marker_freedom = {}; }},
      {"Jitter", AddJitter},
      {"Motion", AddMotion},
      {"MotionAndJitter",
       [](Bundle* bundle) {
         AddMotion(bundle);
         AddJitter(bundle);
       }},
      {"Targets", AddTarget},
      {"CommonNoise", AddCommonNoise}};
  return kCases;
}

class Reduced : public ::testing::TestWithParam<size_t> {};

INSTANTIATE_TEST_SUITE_P(Adjustment,
                         Reduced,
                         ::testing::Range<size_t>(0, Cases().size()),
                         [](const auto& test) { return Cases()[test.param].name; });

TEST_P(Reduced, HasTheOptimumOfAllUnknowns) {
  for (const Loss loss : {Loss::kNone, Loss::kHuber}) {
    Bundle reduced = Stereo(Cases()[GetParam()].frames);
    Cases()[GetParam()].change(&reduced);
    Disturb(&reduced);
    Bundle whole = reduced;
    // Sessions with bounds are solved in all unknowns; these are too far off to matter.
    BundleCamera& bounded = whole.cameras[0];
    bounded.rules.resize(bounded.params.size());
    bounded.rules[0].lower = 1;
    const AdjustOptions options{.loss = loss, .cost_tolerance = 1e-14, .on_iteration = {}};
    const AdjustSummary a = Adjust(&reduced, options), b = Adjust(&whole, options);
    ASSERT_TRUE(a.converged) << a.message;
    ASSERT_TRUE(b.converged) << b.message;
    EXPECT_NEAR(a.cost_before / b.cost_before, 1, 1e-10);
    EXPECT_NEAR(a.cost / b.cost, 1, 1e-9);
    for (size_t c = 0; c < reduced.cameras.size(); ++c) {
      for (size_t k = 0; k < reduced.cameras[c].params.size(); ++k) {
        EXPECT_NEAR(reduced.cameras[c].params[k],
                    whole.cameras[c].params[k],
                    1e-6 * (1 + std::abs(whole.cameras[c].params[k])))
            << c << " " << k;
      }
      EXPECT_LT((reduced.cameras[c].T_camera_rig.t - whole.cameras[c].T_camera_rig.t).norm(), 1e-6);
    }
    for (size_t f = 0; f < reduced.T_rig_target.size(); ++f) {
      for (size_t c = 0; c < 2; ++c) {
        EXPECT_LT((reduced.SeenPose(f, c).t - whole.SeenPose(f, c).t).norm(), 1e-6) << f;
      }
    }
    for (size_t m = 0; m < reduced.markers.size(); ++m) {
      EXPECT_LT((reduced.markers[m].position - whole.markers[m].position).norm(), 1e-6) << m;
      EXPECT_LT((reduced.markers[m].nominal - whole.markers[m].nominal).norm(), 1e-6) << m;
    }
  }
}

TEST_P(Reduced, SumOfSquaresIsThatOfTheElimination) {
  Bundle bundle = Stereo(Cases()[GetParam()].frames);
  Cases()[GetParam()].change(&bundle);
  Disturb(&bundle);
  const internal::Objective huber = internal::ObjectiveOf(bundle, {Loss::kHuber, 3});
  const internal::UnknownLayout layout = internal::MakeLayout(bundle, {true, true});
  const internal::ReducedEquations equations = internal::EliminateFrames(bundle, layout, huber, {});
  EXPECT_TRUE(equations.complete);
  EXPECT_NEAR(equations.squares / internal::SumOfSquares(bundle, huber), 1, 1e-12);
}

}  // namespace TEST_FILE
}  // namespace plenocal
