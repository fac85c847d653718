// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/solve.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "calib/adjust/solver/adjust.h"
#include "calib/base/error.h"
#include "calib/noise/camera_noise.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using testing::MakeProblem;
using testing::Random;
using testing::SyntheticProblem;
using testing::TrueBundle;

SolveOptions Typical(const Bundle& bundle, double sigma) {
  return {.typical_sigmas = std::vector<double>(bundle.cameras.size(), sigma),
          .loss = Loss::kHuber,
          .go_on = [] { return true; },
          .estimate_uncertainty = true};
}

// Adjusts once more, until rounding, with the noise and rejections as they are.
void AdjustFully(Loss loss, Bundle* bundle) {
  AdjustOptions options;
  options.loss = loss;
  options.cost_tolerance = 1e-14;
  ASSERT_TRUE(Adjust(bundle, options).usable);
}

// Sum of squares of the used observations, in their standard deviations.
double Squares(const Bundle& bundle) {
  const std::vector<double> lengths = WeightedLengths(bundle);
  double sum = 0;
  for (size_t i = 0; i < lengths.size(); ++i) {
    if (bundle.observations[i].used) sum += lengths[i] * lengths[i];
  }
  return sum;
}

TEST(Solve, EndsWhereAnotherAdjustmentGainsNothing) {
  const SyntheticProblem problem = MakeProblem(21, {.cameras = 2, .frames = 8, .noise = 0.2});
  Bundle bundle = TrueBundle(problem);
  bundle.cameras[0].params[0] *= 1.01;
  bundle.T_rig_target[2].t.z() += 0.01;
  const Solution solution = Solve(Typical(bundle, 0.2), &bundle);
  EXPECT_TRUE(solution.converged);
  EXPECT_GT(solution.iterations, 0);
  const double squares = Squares(bundle);
  // Noise such that the squares are as many as the degrees of freedom that are left.
  double redundancy = 0;
  for (const double of_camera : solution.uncertainty.redundancy) redundancy += of_camera;
  EXPECT_NEAR(squares / redundancy, 1, 0.01);
  Bundle again = bundle;
  AdjustFully(Loss::kHuber, &again);
  EXPECT_NEAR(again.cameras[0].params[0],
              bundle.cameras[0].params[0],
              0.02 * solution.uncertainty.param_std_errors[0][0]);
}

TEST(Solve, RejectsExactlyGrossErrors) {
  Random random(4);
  const SyntheticProblem problem = MakeProblem(22, {.frames = 10, .noise = 0.1});
  Bundle bundle = TrueBundle(problem);
  std::vector<bool> wrong(bundle.observations.size(), false);
  for (size_t i = 3; i < bundle.observations.size(); i += 37) {
    wrong[i] = true;
    bundle.observations[i].seen.values[i % 2] += random.Uniform(0, 1) < 0.5 ? 5 : -8;
  }
  const Solution solution = Solve(Typical(bundle, 0.1), &bundle);
  size_t good_rejected = 0;
  for (size_t i = 0; i < wrong.size(); ++i) {
    if (wrong[i]) {
      EXPECT_FALSE(bundle.observations[i].used) << i;
    } else {
      good_rejected += !bundle.observations[i].used;
    }
  }
  EXPECT_LE(good_rejected, 2U);  // 0.05 are expected
  // Largest of n Rayleigh lengths, within a factor.
  EXPECT_GT(solution.rejection_threshold, 3);
  EXPECT_LT(solution.rejection_threshold, 6);
}

TEST(Solve, EstimatesFramesBeyondTheFirstOnes) {
  // 40 frames start; the others' poses are ten millimetres off.
  const SyntheticProblem problem = MakeProblem(23, {.frames = 50, .partial = 0.6});
  Bundle bundle = TrueBundle(problem);
  const Bundle truth = bundle;
  for (RigidTransform& pose : bundle.T_rig_target) pose.t.x() += 0.01;
  Solve(Typical(bundle, 1), &bundle);
  for (size_t f = 0; f < truth.T_rig_target.size(); ++f) {
    EXPECT_LT((bundle.T_rig_target[f].t - truth.T_rig_target[f].t).norm(), 1e-6) << f;
  }
}

TEST(Solve, WithLandmarksEndsAtTheirOptimum) {
  const SyntheticProblem problem = MakeProblem(
      24, {.shape = testing::TargetShape::kCorner, .cameras = 2, .frames = 6, .noise = 0.1});
  Bundle bundle = TrueBundle(problem);
  bundle.marker_freedom = MarkerFreedom::Landmarks();
  bundle.fixed_frame = 0;
  for (BundleCamera& camera : bundle.cameras) {
    camera.fixed.assign(camera.fixed.size(), true);
    camera.is_master = true;
  }
  bundle.observations[11].seen.values[0] += 20;
  Solution solution = Solve(Typical(bundle, 0.1), &bundle);
  EXPECT_FALSE(bundle.observations[11].used);
  const double squares = Squares(bundle);
  const double unknowns = 6 * 5 + 3 * static_cast<double>(bundle.markers.size());
  EXPECT_NEAR(
      squares / (UsedCoordinates(bundle)[0] + UsedCoordinates(bundle)[1] - unknowns), 1, 0.01);
  AdjustFully(Loss::kNone, &bundle);
  EXPECT_NEAR(Squares(bundle) / squares, 1, 1e-6);
}

TEST(Solve, StopsInAnyIteration) {
  const SyntheticProblem problem = MakeProblem(25, {.frames = 6, .noise = 0.1});
  for (const int allowed : {0, 2}) {
    Bundle bundle = TrueBundle(problem);
    bundle.cameras[0].params[0] *= 1.05;
    SolveOptions options = Typical(bundle, 0.1);
    int calls = 0;
    options.go_on = [&] { return calls++ < allowed; };
    EXPECT_THROW(Solve(options, &bundle), Stopped);
    EXPECT_EQ(calls, allowed + 1);
  }
}

TEST(Solve, LeavesTheUncertaintyToItsCaller) {
  Bundle bundle = TrueBundle(MakeProblem(26, {.frames = 5, .noise = 0.1}));
  SolveOptions options = Typical(bundle, 0.1);
  options.estimate_uncertainty = false;
  const Bundle start = bundle;
  const double without = (Solve(options, &bundle), bundle.cameras[0].params[0]);
  options.estimate_uncertainty = true;
  Bundle other = start;
  const Solution solution = Solve(options, &other);
  EXPECT_EQ(other.cameras[0].params[0], without);
  EXPECT_EQ(solution.uncertainty.param_std_errors.size(), 1U);
}

TEST(Solve, NamesTheCameraWhoseModelDoesNotSuitTheLens) {
  Bundle bundle = TrueBundle(MakeProblem(27, {.frames = 5, .noise = 0.1}));
  for (RigidTransform& pose : bundle.T_rig_target) pose.t.z() = -pose.t.z();  // behind the camera
  EXPECT_THAT(
      testing::RefusalOf([&] { Solve(Typical(bundle, 0.1), &bundle); }, ErrorKind::kJob),
      ::testing::AllOf(::testing::HasSubstr("cam0: most observations lie outside the domain"),
                       ::testing::HasSubstr("pinhole-radial3")));
}

}  // namespace TEST_FILE
}  // namespace plenocal
