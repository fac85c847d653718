// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/bundle.h"

#include <gtest/gtest.h>

#include <cmath>

#include "calib/adjust/rows.h"
#include "calib/adjust/solver/adjust.h"
#include "models/registry.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

using testing::MakeProblem;
using testing::SyntheticOptions;
using testing::SyntheticProblem;
using testing::TargetShape;
using testing::TrueBundle;

// Exact observations leave residuals of rounding: 1e-16 of 1000 px, solved to 1e-10 of the cost.
constexpr double kExact = 1e-8;  // px
// Costs are sums of some thousand terms, each rounded.
constexpr double kSum = 1e-11;

// Moves everything that is estimated away from the truth.
void Disturb(Bundle* bundle) {
  Vector6d delta;
  delta << 0.002, -0.003, 0.004, 0.01, -0.008, 0.006;
  for (BundleCamera& camera : bundle->cameras) {
    camera.params[0] *= 1.02;
    camera.params[1] *= 0.99;
    camera.params[2] += 5;
    camera.params[4] += 0.01;
    if (!camera.is_master) camera.T_camera_rig = Retract(camera.T_camera_rig, delta);
  }
  for (RigidTransform& T_rig_target : bundle->T_rig_target) {
    T_rig_target = Retract(T_rig_target, delta);
    delta = -delta;
  }
}

double LargestResidual(const Bundle& bundle) {
  double largest = 0;
  for (const BundleObservation& observation : bundle.observations) {
    double residual[kMaxObservationSize];
    if (!Residual(bundle, observation, residual)) return std::numeric_limits<double>::infinity();
    largest = std::max(largest, std::hypot(residual[0], residual[1]));
  }
  return largest;
}

SyntheticProblem Stereo(double noise = 0, double marker_tolerance = 0) {
  return MakeProblem(5,
                     {.shape = TargetShape::kCorner,
                      .cameras = 2,
                      .frames = 8,
                      .noise = noise,
                      .marker_tolerance = marker_tolerance});
}

TEST(Adjust, ReturnsToTheTruthFromADisturbedState) {
  const SyntheticProblem problem = Stereo();
  Bundle bundle = TrueBundle(problem);
  ASSERT_LT(LargestResidual(bundle), kExact);
  Disturb(&bundle);
  ASSERT_GT(LargestResidual(bundle), 1);
  const AdjustSummary summary = Adjust(&bundle, {});
  EXPECT_TRUE(summary.usable) << summary.message;
  EXPECT_TRUE(summary.converged) << summary.message;
  EXPECT_FALSE(summary.stopped);
  EXPECT_LT(LargestResidual(bundle), kExact);
}

TEST(Adjust, NeverMovesTheMaster) {
  const SyntheticProblem problem = Stereo(0.2);
  Bundle bundle = TrueBundle(problem);
  Disturb(&bundle);
  bundle.cameras[0].T_camera_rig.t = Eigen::Vector3d(0.25, 0, 0);
  for (RigidTransform& T : bundle.T_rig_target) T.t.x() -= 0.25;
  const RigidTransform before = bundle.cameras[0].T_camera_rig;
  ASSERT_TRUE(Adjust(&bundle, {}).usable);
  EXPECT_EQ(bundle.cameras[0].T_camera_rig.R, before.R);
  EXPECT_EQ(bundle.cameras[0].T_camera_rig.t, before.t);
}

TEST(Adjust, KeepsHeldParametersToTheBit) {
  const SyntheticProblem problem = Stereo(0.2);
  Bundle bundle = TrueBundle(problem);
  Disturb(&bundle);
  bundle.cameras[1].fixed[0] = true;
  bundle.cameras[1].fixed[5] = true;
  const std::vector<double> before = bundle.cameras[1].params;
  ASSERT_TRUE(Adjust(&bundle, {}).usable);
  for (size_t i = 0; i < before.size(); ++i) {
    EXPECT_EQ(bundle.cameras[1].params[i] == before[i], bundle.cameras[1].fixed[i]) << i;
  }
}

TEST(Adjust, KeepsFixedIntrinsics) {
  Bundle bundle = TrueBundle(Stereo(0.2));
  Disturb(&bundle);
  for (BundleCamera& camera : bundle.cameras) camera.fixed.assign(camera.fixed.size(), true);
  const auto before = bundle.cameras;
  const RigidTransform pose = bundle.T_rig_target[0];
  ASSERT_TRUE(Adjust(&bundle, {}).usable);
  for (size_t c = 0; c < before.size(); ++c) EXPECT_EQ(bundle.cameras[c].params, before[c].params);
  EXPECT_NE(bundle.T_rig_target[0].t, pose.t);
}

TEST(Adjust, HoldsMarkersWithoutAToleranceAndMovesThemWithinOne) {
  for (const double sigma : {0.0, 0.0003}) {
    const SyntheticProblem problem = Stereo(0.1, 0.0003);
    Bundle bundle = TrueBundle(problem);
    bundle.marker_freedom = MarkerFreedom::FromSigma(sigma);
    for (BundleMarker& marker : bundle.markers) marker.position = marker.nominal;
    ASSERT_TRUE(Adjust(&bundle, {}).usable);
    double nominal_error = 0, error = 0;
    for (const BundleMarker& marker : bundle.markers) {
      if (sigma == 0) {
        EXPECT_EQ(marker.position, marker.nominal);
      }
      nominal_error += (marker.nominal - problem.markers.at(marker.number)).squaredNorm();
      error += (marker.position - problem.markers.at(marker.number)).squaredNorm();
    }
    // The observations know the markers better than the target file.
    if (sigma > 0) {
      EXPECT_LT(error, 0.7 * nominal_error);
    }
  }
}

TEST(Adjust, StopsWhenItsCallbackSaysSo) {
  Bundle bundle = TrueBundle(Stereo());
  Disturb(&bundle);
  int calls = 0;
  double last_cost = std::numeric_limits<double>::infinity();
  AdjustOptions options;
  options.on_iteration = [&](int iteration, double cost) {
    EXPECT_EQ(iteration, calls);
    EXPECT_LE(cost, last_cost);
    last_cost = cost;
    return ++calls < 3;
  };
  const AdjustSummary summary = Adjust(&bundle, options);
  EXPECT_EQ(calls, 3);
  EXPECT_TRUE(summary.stopped);
  EXPECT_FALSE(summary.converged);
}

TEST(Adjust, RefusesObservationsOutsideTheDomainAndLeavesUnusedOnesAlone) {
  Bundle bundle = TrueBundle(Stereo());
  Disturb(&bundle);
  BundleMarker behind = bundle.markers.back();
  const RigidTransform T_target_camera =
      (bundle.cameras[0].T_camera_rig * bundle.T_rig_target[0]).Inverse();
  behind.number = 99999;
  behind.position = behind.nominal = T_target_camera * Eigen::Vector3d(0, 0, -0.5);
  bundle.markers.push_back(behind);
  BundleObservation outside = bundle.observations.front();
  ASSERT_EQ(outside.camera, 0);
  ASSERT_EQ(outside.frame, 0);
  outside.marker = static_cast<int>(bundle.markers.size()) - 1;
  bundle.observations.insert(bundle.observations.begin(), outside);
  double residual[kMaxObservationSize];
  EXPECT_FALSE(Residual(bundle, bundle.observations[0], residual));

  // Used: no perfect point, but a failure that leaves the state alone.
  const std::vector<double> before = bundle.cameras[0].params;
  const AdjustSummary failed = Adjust(&bundle, {});
  EXPECT_FALSE(failed.usable);
  EXPECT_FALSE(failed.message.empty());
  EXPECT_EQ(bundle.cameras[0].params, before);

  bundle.observations[0].used = false;
  EXPECT_TRUE(Adjust(&bundle, {}).usable);
  bundle.observations.erase(bundle.observations.begin());
  EXPECT_LT(LargestResidual(bundle), kExact);
}

const CameraModel& PinholeRadial3() { return *FindModel(CameraModels(), "pinhole-radial3"); }

// Without derivatives for points on the right: the other half of the observations decides.
bool ProjectWithHalfOfTheJacobians(const CameraModel& /*model*/,
                                   const double* params,
                                   const double* config,
                                   const double* values,
                                   const Eigen::Vector3d& p_cam,
                                   double h,
                                   const ProjectionOutput& out) {
  return p_cam.x() < 0 &&
         PinholeRadial3().ProjectWithJacobian(params, config, values, p_cam, out, h);
}

// Derivatives at the edge of a domain may not exist where the residual still does.
TEST(Adjust, GoesOnWhereOnlyDerivativesAreMissing) {
  CameraModel model = PinholeRadial3();
  model.functions.project_with_jacobian = ProjectWithHalfOfTheJacobians;
  Bundle bundle = TrueBundle(Stereo());
  Disturb(&bundle);
  for (BundleCamera& camera : bundle.cameras) camera.model = &model;
  EXPECT_TRUE(Adjust(&bundle, {}).usable);
  for (BundleCamera& camera : bundle.cameras) camera.model = &PinholeRadial3();
  EXPECT_LT(LargestResidual(bundle), kExact);
}

TEST(Adjust, MinimisesTheLossThatItStates) {
  constexpr double kWidth = 2;
  for (const Loss loss : {Loss::kNone, Loss::kHuber, Loss::kCauchy}) {
    SyntheticProblem problem = Stereo(0.2, 0.0002);
    Bundle bundle = TrueBundle(problem);
    bundle.cameras[1].noise.detector_scale = 1.2;
    bundle.cameras[1].noise.additive_sigma = 0.15;
    for (size_t i = 0; i < bundle.observations.size(); i += 17) {
      bundle.observations[i].seen.values[0] += 3;  // 15 sigma
    }
    const auto cost = [&](const Bundle& state) {
      double sum = 0;
      for (const BundleObservation& observation : state.observations) {
        double residual[kMaxObservationSize];
        EXPECT_TRUE(Residual(state, observation, residual));
        const double s = WeightedLength(state, observation, residual);
        if (loss == Loss::kNone || (loss == Loss::kHuber && s <= kWidth)) {
          sum += s * s;
        } else if (loss == Loss::kHuber) {
          sum += 2 * kWidth * s - kWidth * kWidth;
        } else {
          sum += kWidth * kWidth * std::log1p(s * s / (kWidth * kWidth));
        }
      }
      for (const BundleMarker& marker : state.markers) {
        sum += (marker.position - marker.nominal).squaredNorm() / state.marker_freedom.Variance();
      }
      return sum / 2;
    };
    const double before = cost(bundle);
    AdjustOptions options;
    options.loss = loss;
    options.loss_width = kWidth;
    options.cost_tolerance = 1e-14;
    const AdjustSummary summary = Adjust(&bundle, options);
    ASSERT_TRUE(summary.usable);
    const double after = cost(bundle);
    EXPECT_NEAR(summary.cost, after, kSum * after);
    EXPECT_LT(after, before);
    // A minimum: a step either way costs more by the same amount (its square).
    const auto expect_flat = [&](const char* what, double sigma, auto&& value) {
      Bundle moved = bundle;
      value(moved) += sigma;
      const double up = cost(moved) - after;
      value(moved) -= 2 * sigma;
      const double down = cost(moved) - after;
      EXPECT_GT(up, 0) << what;
      EXPECT_GT(down, 0) << what;
      EXPECT_NEAR(up / down, 1, 0.05) << what;
    };
    expect_flat("f_x", 0.1, [](Bundle& b) -> double& { return b.cameras[1].params[0]; });
    expect_flat("c_y", 0.1, [](Bundle& b) -> double& { return b.cameras[0].params[3]; });
    expect_flat("t_x", 1e-5, [](Bundle& b) -> double& { return b.cameras[1].T_camera_rig.t.x(); });
    expect_flat("pose", 1e-5, [](Bundle& b) -> double& { return b.T_rig_target[2].t.y(); });
    expect_flat("marker", 1e-5, [](Bundle& b) -> double& { return b.markers[7].position.z(); });
  }
}

TEST(Linearise, AgreesWithDifferencesInEveryUnknown) {
  constexpr double kStep = 1e-6;        // of unknowns of size 1, m and rad
  constexpr double kDerivative = 1e-6;  // 1e-16 / kStep of rounding times the length of a row
  const SyntheticProblem problem = Stereo(0.3);
  Bundle bundle = TrueBundle(problem);
  constexpr size_t kFrame = 3;
  // Motion and jitter of the view, a time shift and shared errors.
  bundle.motion.resize(bundle.T_rig_target.size() * 2);
  bundle.jitter.delta.assign(bundle.motion.size(), Vector6d::Zero());
  const size_t view = bundle.View(kFrame, 1);
  bundle.motion[view].at_zero_shift << -0.02, 0.01, 0.03, 0.1, 0.2, -0.3;
  bundle.motion[view].velocity << 0.3, -0.2, 0.1, 0.5, 0.4, -0.6;
  bundle.jitter.delta[view] << 0.01, 0.02, -0.01, -0.2, 0.1, 0.15;
  for (const NuisanceKind* kind : {&nuisances::kSharedError,
                                   &nuisances::kSharedError,
                                   &nuisances::kTimeShift,
                                   &nuisances::kSharedError}) {
    AddNuisance(*kind, 1, &bundle.cameras[1]);
  }
  for (BundleObservation& observation : bundle.observations) {
    if (observation.camera != 1 || observation.frame != kFrame || observation.marker % 10 != 0) {
      continue;
    }
    observation.by_nuisance = {0.3, 0.1, -0.2, 0.4, 0.25, -0.15};
    const auto n = static_cast<Eigen::Index>(bundle.cameras[1].params.size());
    // The bundle after a step of all unknowns: parameters, extrinsics, pose, jitter, marker.
    const auto linearise = [&](const Eigen::VectorXd& step, internal::LinearisedRows rows) {
      Bundle moved = bundle;
      BundleCamera& camera = moved.cameras[1];
      for (Eigen::Index k = 0; k < n; ++k) camera.params[static_cast<size_t>(k)] += step[k];
      camera.T_camera_rig = Retract(camera.T_camera_rig, step.segment<6>(n));
      moved.T_rig_target[kFrame] = Retract(moved.T_rig_target[kFrame], step.segment<6>(n + 6));
      moved.jitter.delta[view] += step.segment<6>(n + 12);
      return internal::Linearise(
          camera,
          internal::ViewOf(moved, kFrame, 1),
          moved.markers[static_cast<size_t>(observation.marker)].position + step.tail<3>(),
          observation,
          rows);
    };
    Eigen::Vector2d residual;
    Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor> J_params(2, n);
    Eigen::Matrix<double, 2, 6, Eigen::RowMajor> J_extrinsics, J_pose, J_jitter;
    Eigen::Matrix<double, 2, 3, Eigen::RowMajor> J_marker;
    if (!linearise(Eigen::VectorXd::Zero(n + 21),
                   {residual.data(),
                    J_params.data(),
                    J_extrinsics.data(),
                    J_pose.data(),
                    J_marker.data()})) {
      continue;
    }
    const internal::ViewCharts charts = internal::ChartsOf(bundle, kFrame, 1);
    J_jitter = J_pose * charts.jitter;
    J_pose = (J_pose * charts.pose).eval();
    Eigen::MatrixXd J(2, n + 21);
    J << J_params, J_extrinsics, J_pose, J_jitter, J_marker;
    for (Eigen::Index k = 0; k < J.cols(); ++k) {
      const double size = k < n ? std::abs(bundle.cameras[1].params[static_cast<size_t>(k)]) : 0;
      const Eigen::VectorXd step =
          Eigen::VectorXd::Unit(J.cols(), k) * (kStep * std::max(1.0, size));
      Eigen::Vector2d r_up, r_down;
      ASSERT_TRUE(linearise(step, {.residual = r_up.data()}));
      ASSERT_TRUE(linearise(-step, {.residual = r_down.data()}));
      const Eigen::Vector2d numeric = (r_up - r_down) / (2 * step[k]);
      EXPECT_LT((J.col(k) - numeric).norm(), kDerivative * (1 + J.norm())) << "unknown " << k;
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
