// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/layout.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <tuple>

#include "calib/adjust/landmarks.h"
#include "calib/adjust/reduced/elimination.h"
#include "calib/adjust/rows.h"
#include "tests/calib/dense_problem.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal::internal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using testing::MakeProblem;
using testing::Random;
using testing::TrueBundle;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Three cameras of seven parameters: the second has a fixed one and two that are tied to the
// first's, the third no data. A second target is free, a third one fixed.
Bundle Session(double tolerance = 0) {
  Bundle bundle = TrueBundle(
      MakeProblem(3, {.cameras = 3, .frames = 3, .noise = 0.2, .marker_tolerance = tolerance}));
  BundleCamera& second = bundle.cameras[1];
  second.rules.resize(7);
  second.rules[2].tied_to = ParamIndex{0, 2};
  second.rules[5].tied_to = ParamIndex{0, 5};
  second.fixed[3] = true;
  bundle.cameras[0].fixed[6] = true;
  for (BundleObservation& each : bundle.observations) each.used = each.camera != 2;
  bundle.targets = {{"first", {}, true}, {"second", {}, false}, {"third", {}, true}};
  for (size_t m = 0; m < bundle.markers.size(); ++m) bundle.markers[m].target = m < 20 ? 1 : 0;
  return bundle;
}

TEST(UnknownLayout, NumbersCamerasThenTargetsThenMarkers) {
  Bundle bundle = Session();
  const UnknownLayout layout = MakeLayout(bundle);
  EXPECT_THAT(CamerasWithData(bundle), ElementsAre(true, true, false));
  EXPECT_THAT(layout.params[0], ElementsAre(0, 1, 2, 3, 4, 5, -1));
  EXPECT_THAT(layout.params[1], ElementsAre(6, 7, 2, -1, 8, 5, 9));
  EXPECT_THAT(layout.params[2], ElementsAre(-1, -1, -1, -1, -1, -1, -1));
  EXPECT_THAT(layout.extrinsics, ElementsAre(-1, 10, -1));
  EXPECT_THAT(layout.targets, ElementsAre(-1, 16, -1));
  EXPECT_THAT(layout.first, ElementsAre(0, 6, 16, 16));
  EXPECT_EQ(layout.head, 22);
  EXPECT_EQ(layout.total, 22);
  EXPECT_EQ(layout.scales, -1);
  EXPECT_FALSE(layout.markers);
  EXPECT_THAT(UnknownsOf(layout, 1),
              ElementsAre(2, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21));
  EXPECT_THAT(UnknownsOf(layout, 0), ElementsAre(0, 1, 2, 3, 4, 5, 16, 17, 18, 19, 20, 21));

  bundle.marker_freedom = MarkerFreedom::FromSigma(0.001);
  bundle.scales.resize(2);
  const UnknownLayout with_markers = MakeLayout(bundle);
  EXPECT_EQ(with_markers.scales, 22);
  EXPECT_EQ(with_markers.head, 24);
  EXPECT_TRUE(with_markers.markers);
  EXPECT_EQ(with_markers.Marker(2), 30);
  EXPECT_EQ(with_markers.total, 24 + 3 * 70);
  EXPECT_EQ(with_markers.Markers(), 210);
  EXPECT_THAT(UnknownsOf(with_markers, 2), ElementsAre(16, 17, 18, 19, 20, 21, 22, 23));

  bundle.marker_freedom = MarkerFreedom::Landmarks();
  const UnknownLayout landmarks = MakeLayout(bundle);
  EXPECT_FALSE(landmarks.markers);
  EXPECT_EQ(landmarks.scales, -1);
  EXPECT_EQ(landmarks.total, 22);
}

TEST(UnknownLayout, CountsTiedParametersOfOneCameraOnce) {
  Bundle bundle = Session();
  bundle.cameras[1].rules[1].tied_to = ParamIndex{1, 0};
  const UnknownLayout layout = MakeLayout(bundle);
  EXPECT_THAT(layout.params[1], ElementsAre(6, 6, 2, -1, 7, 5, 8));
  EXPECT_THAT(UnknownsOf(layout, 1),
              ElementsAre(2, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20));
}

TEST(UnknownLayout, HasThePriorsUnknownsWhereAsked) {
  Bundle bundle = Session();
  bundle.prior.emplace().unknowns = {{.camera = 2, .param = 0}};
  EXPECT_EQ(MakeLayout(bundle).head, 22);
  const UnknownLayout layout = MakeLayout(bundle, true);
  EXPECT_THAT(layout.params[2], ElementsAre(16, 17, 18, 19, 20, 21, 22));
  EXPECT_THAT(layout.extrinsics, ElementsAre(-1, 10, 23));
  EXPECT_EQ(layout.head, 35);
}

TEST(UnknownLayout, LeavesOutParametersAtABound) {
  Bundle bundle = Session();
  bundle.cameras[0].at_bound.assign(7, false);
  bundle.cameras[0].at_bound[2] = true;
  const UnknownLayout layout = MakeLayout(bundle);
  EXPECT_THAT(layout.params[0], ElementsAre(0, 1, -1, 2, 3, 4, -1));
  EXPECT_EQ(layout.params[1][2], -1);
}

TEST(UnknownLayout, HasValuesAndBoundsOfSteps) {
  Bundle bundle = Session();
  bundle.cameras[0].params[2] = 600;
  bundle.cameras[0].rules.resize(7);
  bundle.cameras[0].rules[0].upper = bundle.cameras[0].params[0] + 4;
  bundle.cameras[0].rules[2].lower = 590;
  bundle.cameras[0].rules[2].upper = 650;
  bundle.cameras[1].params[2] = 600;
  bundle.cameras[1].rules[2].lower = 580;
  bundle.cameras[1].rules[2].upper = 620;
  bundle.cameras[1].params[4] = 0.1;
  bundle.cameras[1].rules[4].upper = 0.3;
  const UnknownLayout layout = MakeLayout(bundle);
  const Eigen::VectorXd values = Values(layout, bundle);
  EXPECT_EQ(values[0], bundle.cameras[0].params[0]);
  EXPECT_EQ(values[2], 600);
  EXPECT_EQ(values[6], bundle.cameras[1].params[0]);
  EXPECT_EQ(values[9], bundle.cameras[1].params[6]);
  EXPECT_EQ(values.tail(12), Eigen::VectorXd::Zero(12));
  const StepBounds bounds = BoundsOfStep(layout, bundle);
  EXPECT_EQ(bounds.lower[2], -10);  // the nearer one of both cameras
  EXPECT_EQ(bounds.upper[2], 20);
  EXPECT_NEAR(bounds.upper[8], 0.2, 1e-15);
  EXPECT_EQ(bounds.lower[8], -kInfinity);
  EXPECT_EQ(bounds.upper[0], 4);
  EXPECT_EQ(bounds.upper[1], kInfinity);
  EXPECT_EQ(bounds.lower.size(), 22);
}

TEST(UnknownLayout, MovesEachUnknownInItsChart) {
  const Bundle before = Session(0.001);
  Bundle after = before;
  after.scales = {{.value = 0.5}};
  const UnknownLayout layout = MakeLayout(after);
  Random random(4);
  const Eigen::VectorXd step =
      Eigen::VectorXd::NullaryExpr(layout.total, [&] { return random.Gaussian(1e-3); });
  const BundleState scaled = after;
  Move(layout, step, &after);
  EXPECT_EQ(after.cameras[0].params[0], before.cameras[0].params[0] + step[0]);
  EXPECT_EQ(after.cameras[1].params[2], before.cameras[1].params[2] + step[2]);
  EXPECT_EQ(after.cameras[1].params[3], before.cameras[1].params[3]);
  EXPECT_EQ(after.cameras[2].params, before.cameras[2].params);
  const RigidTransform extrinsics =
      Retract(before.cameras[1].T_camera_rig, step.segment<6>(layout.extrinsics[1]));
  EXPECT_EQ(after.cameras[1].T_camera_rig.t, extrinsics.t);
  EXPECT_EQ(after.cameras[1].T_camera_rig.R, extrinsics.R);
  EXPECT_EQ(after.scales[0].value, 0.5 + step[layout.scales]);
  const RigidTransform moved = Retract({}, step.segment<6>(layout.targets[1]));
  EXPECT_LT((after.targets[1].T_target_own.t - moved.t).norm(), 1e-15);
  for (size_t m = 0; m < before.markers.size(); ++m) {
    const int i = static_cast<int>(m);
    Eigen::Vector3d expected = before.markers[m].position + step.segment<3>(layout.Marker(i)) +
                               step[layout.scales] * scaled.ByScale(scaled.scales[0], i);
    if (before.markers[m].target == 1) expected = moved * expected;
    EXPECT_LT((after.markers[m].position - expected).norm(), 1e-12) << m;
  }
}

TEST(UnknownLayout, MovesScalesThatComeFirst) {
  Bundle bundle = TrueBundle(MakeProblem(3, {.cameras = 1, .frames = 1}));
  bundle.cameras[0].fixed.assign(7, true);
  bundle.marker_freedom = MarkerFreedom::Held();
  bundle.scales = {{.axes = Eigen::Vector3d::UnitX()}, {.axes = Eigen::Vector3d::UnitY()}};
  const UnknownLayout layout = MakeLayout(bundle);
  ASSERT_EQ(layout.scales, 0);
  ASSERT_EQ(layout.head, 2);
  EXPECT_THAT(UnknownsOf(layout, 0), ElementsAre(0, 1));
  const Bundle before = bundle;
  Eigen::VectorXd step = Eigen::VectorXd::Zero(layout.total);
  step.head<2>() << 0.01, -0.02;
  Move(layout, step, &bundle);
  EXPECT_EQ(bundle.scales[0].value, 0.01);
  EXPECT_EQ(bundle.scales[1].value, -0.02);
  for (size_t m = 0; m < bundle.markers.size(); ++m) {
    const Eigen::Vector3d expected =
        Eigen::Vector3d(1.01, 0.98, 1).cwiseProduct(before.markers[m].position);
    EXPECT_LT((bundle.markers[m].position - expected).norm(), 1e-12) << m;
  }
}

// Nothing is estimated before the extrinsics, or before the pose of a target.
TEST(UnknownLayout, MovesExtrinsicsAndTargetsThatComeFirst) {
  Bundle bundle = Session();
  for (BundleCamera& camera : bundle.cameras) {
    camera.rules.clear();
    camera.fixed.assign(7, true);
  }
  const Vector6d step = 0.01 * Vector6d::LinSpaced(6, 1, 6);
  for (const bool of_target : {false, true}) {
    bundle.cameras[1].is_master = of_target;
    bundle.targets[1].is_fixed = !of_target;
    const UnknownLayout layout = MakeLayout(bundle);
    ASSERT_EQ(layout.head, 6);
    EXPECT_THAT(UnknownsOf(layout, 1), ElementsAre(0, 1, 2, 3, 4, 5));
    EXPECT_THAT(UnknownsOf(layout, 0).size(), of_target ? 6 : 0);
    Bundle moved = bundle;
    Move(layout, step, &moved);
    const auto& [before, after] =
        of_target ? std::pair(bundle.targets[1].T_target_own, moved.targets[1].T_target_own)
                  : std::pair(bundle.cameras[1].T_camera_rig, moved.cameras[1].T_camera_rig);
    EXPECT_LT((LocalCoordinates(before, after) - step).norm(), 1e-12);
  }
}

TEST(EstimatesLocalModel, WhereItsParametersAreFree) {
  Bundle bundle = Session();
  EXPECT_FALSE(EstimatesLocalModel(bundle));
  CameraModel local = *bundle.cameras[1].model;
  local.support_size = 1;
  bundle.cameras[1].model = &local;
  EXPECT_TRUE(EstimatesLocalModel(bundle));
  bundle.cameras[1].fixed.assign(7, true);
  EXPECT_FALSE(EstimatesLocalModel(bundle));
  bundle.cameras[1].fixed[6] = false;
  EXPECT_TRUE(EstimatesLocalModel(bundle));
}

TEST(SetAtBounds, FindsTheBoundsOfTiedParametersAlone) {
  Bundle bundle = Session();  // the first camera has no rules
  bundle.cameras[0].params[2] = bundle.cameras[1].params[2] = 640;
  bundle.cameras[1].rules[2].lower = 640;
  SetAtBounds(&bundle);
  EXPECT_THAT(bundle.cameras[0].at_bound,
              ElementsAre(false, false, true, false, false, false, false));
  EXPECT_TRUE(bundle.cameras[1].at_bound[2]);
  bundle.cameras[0].params[2] = bundle.cameras[1].params[2] = 641;
  SetAtBounds(&bundle);
  EXPECT_FALSE(bundle.cameras[1].at_bound[2]);
}

TEST(SetAtBounds, FindsParametersAtABoundButForRounding) {
  Bundle bundle = Session();
  BundleCamera& first = bundle.cameras[0];
  first.rules.resize(7);
  first.params[0] = 500 * (1 + 2e-16);
  first.rules[0].lower = 500;
  first.params[1] = 500.001;
  first.rules[1].lower = 500;
  first.params[3] = 0.25;
  first.rules[3].upper = 0.25;
  first.params[6] = 1;  // fixed
  first.rules[6].upper = 1;
  // The tied one of another camera is at the bound of its own rule.
  first.params[2] = bundle.cameras[1].params[2] = 640;
  bundle.cameras[1].rules[2].upper = 640;
  SetAtBounds(&bundle);
  EXPECT_THAT(first.at_bound, ElementsAre(true, false, true, true, false, false, false));
  EXPECT_EQ(first.params[0], 500);
  EXPECT_THAT(bundle.cameras[1].at_bound,
              ElementsAre(false, false, true, false, false, false, false));
  EXPECT_TRUE(bundle.cameras[2].at_bound.empty());
  // A tied parameter has the value of its root.
  first.params[5] = 0.125;
  SetAtBounds(&bundle);
  EXPECT_EQ(bundle.cameras[1].params[5], 0.125);
}

TEST(WithinDomain, IsOfTheChosenCameras) {
  Bundle bundle = Session();
  EXPECT_TRUE(WithinDomain(bundle, {true, true, true}));
  bundle.cameras[1].params[0] = -1;
  EXPECT_FALSE(WithinDomain(bundle, {true, true, true}));
  EXPECT_FALSE(WithinDomain(bundle, {false, true, false}));
  EXPECT_TRUE(WithinDomain(bundle, {true, false, true}));
}

// The gradient of the reduced system at an optimum of the poses is that of half the sum of squares,
// and its matrix is the Schur complement of the dense normal matrix.
TEST(EliminateFrames, IsTheSchurComplementOfTheWholeSystem) {
  for (const double jitter : {0.0, 0.002}) {
    Bundle bundle = Session(0.001);
    bundle.scales.clear();
    if (jitter > 0) {
      bundle.jitter.translation_sigma = jitter;
      bundle.jitter.rotation_sigma = 2 * jitter;
      bundle.jitter.delta.assign(9, Vector6d::Constant(1e-4));
      bundle.jitter.misplaced.assign(9, false);
    }
    const UnknownLayout layout = MakeLayout(bundle);
    const Objective objective = ObjectiveOf(bundle, {});
    const ReducedEquations equations = EliminateFrames(bundle, layout, objective, 0, {});
    ASSERT_TRUE(equations.complete);
    EXPECT_NEAR(equations.squares, SumOfSquares(bundle, objective), 1e-9 * equations.squares);
    testing::DenseProblem dense{bundle};
    dense.Differentiate();
    const auto& [r, J, N] = std::tie(dense.residuals, dense.J, dense.N);
    EXPECT_NEAR(r.squaredNorm() / equations.squares, 1, 1e-9) << jitter;
    const Eigen::Index total = layout.total;
    const Eigen::VectorXd g = J.transpose() * r;
    const Eigen::Index rest = dense.Size() - total;
    const Eigen::MatrixXd solved =
        N.bottomRightCorner(rest, rest).ldlt().solve(N.bottomLeftCorner(rest, total));
    const Eigen::MatrixXd S =
        N.topLeftCorner(total, total) - N.topRightCorner(total, rest) * solved;
    const Eigen::VectorXd gradient = g.head(total) - solved.transpose() * g.tail(rest);
    for (Eigen::Index i = 0; i < total; ++i) {
      for (Eigen::Index j = 0; j <= i; ++j) {
        EXPECT_NEAR(equations.S(i, j), S(i, j), 1e-4 * std::sqrt(N(i, i) * N(j, j)))
            << i << " " << j;
      }
      EXPECT_NEAR(equations.S(total, i), gradient[i], 1e-4 * std::sqrt(N(i, i)) * r.norm()) << i;
      if (i < layout.head) {
        EXPECT_NEAR(equations.diagonal[i], N(i, i), 1e-4 * N(i, i)) << i;
      }
      if (HasFailure()) return;
    }
  }
}

TEST(LineariseLandmark, HasTheGradientOfHubersLoss) {
  Bundle bundle = TrueBundle(MakeProblem(8, {.cameras = 2, .frames = 3, .noise = 0.2}));
  const std::vector<std::vector<size_t>> of_marker = ObservationsOfMarkers(bundle);
  ASSERT_EQ(of_marker.size(), 70U);
  const std::vector<size_t>& seen = of_marker[33];
  size_t all = 0;
  for (const auto& each : of_marker) all += each.size();
  EXPECT_EQ(all, bundle.observations.size());
  for (const size_t i : seen) EXPECT_EQ(bundle.observations[i].marker, 33);
  bundle.observations[seen[1]].seen.values[0] += 4;  // beyond the width
  bundle.observations[seen[2]].used = false;         // counts all the same
  constexpr double kWidth = 3;
  const auto cost = [&](const Eigen::Vector3d& moved) {
    Bundle other = bundle;
    other.markers[33].position += moved;
    double sum = 0;
    for (const size_t i : seen) {
      double residual[kMaxObservationSize];
      EXPECT_TRUE(Residual(other, other.observations[i], residual));
      const double s = WeightedLength(other, other.observations[i], residual);
      sum += s <= kWidth ? s * s / 2 : kWidth * s - kWidth * kWidth / 2;
    }
    return sum;
  };
  const LandmarkEquations equations = LineariseLandmark(bundle, seen, kWidth);
  for (Eigen::Index k = 0; k < 3; ++k) {
    const Eigen::Vector3d step = 1e-7 * Eigen::Vector3d::Unit(k);
    EXPECT_NEAR((cost(step) - cost(-step)) / 2e-7, equations.g[k], 1e-4 * equations.g.norm());
  }
  // Twice the noise is a quarter of the information.
  const LandmarkEquations wide = LineariseLandmark(bundle, seen, 1e9);
  for (BundleObservation& each : bundle.observations) each.assumed_sigma *= 2;
  EXPECT_LT((LineariseLandmark(bundle, seen, 1e9).H - wide.H / 4).norm(), 1e-9 * wide.H.norm());
  // A common error takes its part of the weight.
  for (BundleCamera& camera : bundle.cameras) camera.noise.common_sigma = 0.4;
  EXPECT_LT((LineariseLandmark(bundle, seen, 1e9).H - wide.H / 8).norm(), 1e-9 * wide.H.norm());
}

TEST(AdjustLandmark, FindsThePointOfItsRays) {
  Bundle bundle = TrueBundle(MakeProblem(8, {.cameras = 2, .frames = 3}));
  const Eigen::Vector3d truth = bundle.markers[12].position;
  bundle.markers[12].position += Eigen::Vector3d(0.01, -0.02, 0.015);
  const std::vector<size_t> seen = ObservationsOfMarkers(bundle)[12];
  AdjustLandmark({}, &bundle);
  EXPECT_GT((bundle.markers[12].position - truth).norm(), 0.02);
  AdjustLandmark(seen, &bundle);
  EXPECT_LT((bundle.markers[12].position - truth).norm(), 1e-3);
  for (int i = 0; i < 3; ++i) AdjustLandmark(seen, &bundle);
  EXPECT_LT((bundle.markers[12].position - truth).norm(), 1e-9);
  // Where none projects it stays.
  const Eigen::Vector3d behind = bundle.T_rig_target[0].Inverse() * Eigen::Vector3d(0, 0, -9);
  bundle.markers[12].position = behind;
  AdjustLandmark({seen.data(), 1}, &bundle);
  EXPECT_EQ(bundle.markers[12].position, behind);
}

// Steps end where one is shorter than a standard error.
TEST(AdjustLandmark, TakesAnotherStepAfterOneOfASigmaOrMore) {
  const auto error_with = [](double length) {
    Bundle bundle = TrueBundle(MakeProblem(8, {.cameras = 2, .frames = 3}));
    const Eigen::Vector3d truth = bundle.markers[12].position;
    bundle.markers[12].position += Eigen::Vector3d(0.01, -0.02, 0.015);
    const std::vector<size_t> seen = ObservationsOfMarkers(bundle)[12];
    double squares = 0;
    for (const size_t i : seen) {
      double residual[kMaxObservationSize];
      EXPECT_TRUE(Residual(bundle, bundle.observations[i], residual));
      squares += residual[0] * residual[0] + residual[1] * residual[1];
    }
    for (BundleObservation& each : bundle.observations) {
      each.assumed_sigma = std::sqrt(squares) / length;
    }
    AdjustLandmark(seen, &bundle);
    return (bundle.markers[12].position - truth).norm();
  };
  const double one_step = error_with(0.9);
  EXPECT_GT(one_step, 1e-6);
  EXPECT_LT(error_with(1.1), 0.1 * one_step);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
