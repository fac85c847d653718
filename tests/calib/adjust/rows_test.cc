// SPDX-License-Identifier: Apache-2.0
//
// Rows of a marker's observations: losses, common noise and missing derivatives.
#include "calib/adjust/rows.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <iterator>

#include "calib/io/yaml.h"
#include "models/formula/model.h"
#include "models/registry.h"
#include "tests/calib/synthetic.h"

namespace plenocal::internal {
namespace TEST_FILE {

using testing::MakeProblem;
using testing::TrueBundle;

constexpr RowColumns kAll{.params = true, .extrinsics = true, .pose = true, .marker = true};
constexpr double kWidth = 1.5;

// One marker, measured three times in a view, at 0.9, 2.5 and 7 sigmas.
class MarkerRowsOfOneMarker : public ::testing::Test {
 protected:
  MarkerRowsOfOneMarker() : bundle_(TrueBundle(MakeProblem(3, {.cameras = 2, .frames = 1}))) {
    camera().noise.additive_sigma = 0.1;
    const BundleObservation& first = *std::ranges::find_if(
        bundle_.observations,
        [](const auto& each) { return each.camera == 1 && each.marker == 33; });
    marker_ = bundle_.markers[static_cast<size_t>(first.marker)].position;
    for (const double angle : {0.3, 1.9, 4.0}) {
      BundleObservation seen = first;
      seen.assumed_sigma = 0.2 + 0.05 * angle;
      const double length = angle < 1 ? 0.9 : angle < 3 ? 2.5 : 7;
      const double sigma = camera().noise.Sigma(seen.assumed_sigma);
      seen.seen.values[0] += length * sigma * std::cos(angle);
      seen.seen.values[1] += length * sigma * std::sin(angle);
      lengths_.push_back(length);
      observations_.push_back(seen);
    }
  }
  BundleCamera& camera() { return bundle_.cameras[1]; }
  // Of a step of parameters, extrinsics, the seen pose and the marker.
  Eigen::VectorXd Residuals(const Eigen::VectorXd& step, const RobustLoss& loss) {
    Bundle moved = bundle_;
    BundleCamera& of = moved.cameras[1];
    const auto n = static_cast<Eigen::Index>(of.params.size());
    for (Eigen::Index k = 0; k < n; ++k) of.params[static_cast<size_t>(k)] += step[k];
    LinearisedView view = ViewOf(moved, 0, 1);
    view.T_camera_rig = Retract(view.T_camera_rig, step.segment<6>(n));
    view.T_rig_target = Retract(view.T_rig_target, step.segment<6>(n + 6));
    MarkerRows rows(of, {});
    EXPECT_TRUE(rows.Load(view, marker_ + step.tail<3>(), observations_, loss));
    return rows.Residual();
  }

  Bundle bundle_;
  Eigen::Vector3d marker_;
  std::vector<BundleObservation> observations_;
  std::vector<double> lengths_;
};

TEST_F(MarkerRowsOfOneMarker, HaveTheSquaresOfTheirLoss) {
  const auto rho = [](Loss loss, double s) {
    if (loss == Loss::kHuber && s > kWidth) return 2 * kWidth * s - kWidth * kWidth;
    if (loss == Loss::kCauchy) return kWidth * kWidth * std::log1p(s * s / (kWidth * kWidth));
    return s * s;
  };
  MarkerRows rows(camera(), kAll);
  for (const Loss loss : {Loss::kNone, Loss::kHuber, Loss::kCauchy}) {
    ASSERT_TRUE(rows.Load(ViewOf(bundle_, 0, 1), marker_, observations_, {loss, kWidth}));
    ASSERT_EQ(rows.Count(), 6);
    EXPECT_EQ(rows.Marker(), observations_[0].marker);
    for (Eigen::Index i = 0; i < 3; ++i) {
      const double s = lengths_[static_cast<size_t>(i)];
      EXPECT_NEAR(rows.Residual().segment<2>(2 * i).squaredNorm(), rho(loss, s), 1e-6);
    }
  }
  // Reweighted: by the root of Huber's weight, width / length.
  ASSERT_TRUE(
      rows.Load(ViewOf(bundle_, 0, 1), marker_, observations_, {Loss::kHuber, kWidth, true}));
  EXPECT_NEAR(rows.Residual().head<2>().norm(), 0.9, 1e-6);
  EXPECT_NEAR(rows.Residual().tail<2>().squaredNorm(), kWidth * 7, 1e-6);
  MarkerRows plain(camera(), kAll);
  plain.Load(ViewOf(bundle_, 0, 1), marker_, observations_, {});
  EXPECT_LT(
      (rows.Pose().bottomRows<2>() - std::sqrt(kWidth / 7) * plain.Pose().bottomRows<2>()).norm(),
      1e-9 * plain.Pose().norm());
  // Those that are not used have no rows.
  observations_[1].used = false;
  ASSERT_TRUE(rows.Load(ViewOf(bundle_, 0, 1), marker_, observations_, {}));
  EXPECT_EQ(rows.Count(), 4);
  EXPECT_NEAR(rows.Residual().tail<2>().norm(), 7, 1e-6);
}

TEST_F(MarkerRowsOfOneMarker, HaveTheDerivativesOfTheirLoss) {
  for (const double common : {0.0, 0.15}) {
    camera().noise.common_sigma = common;
    for (const Loss loss : {Loss::kNone, Loss::kHuber, Loss::kCauchy}) {
      MarkerRows rows(camera(), kAll);
      ASSERT_TRUE(rows.Load(ViewOf(bundle_, 0, 1), marker_, observations_, {loss, kWidth}));
      const Eigen::Index n = rows.Params().cols(), size = n + 15;
      Eigen::MatrixXd J(6, size);
      J << rows.Params(), rows.Extrinsics(), rows.Pose(), rows.Position();
      EXPECT_LT((rows.Residual() - Residuals(Eigen::VectorXd::Zero(size), {loss, kWidth})).norm(),
                1e-9);
      for (Eigen::Index k = 0; k < size; ++k) {
        const double step = k < 4 ? 1e-3 : 1e-6;
        const Eigen::VectorXd unit = step * Eigen::VectorXd::Unit(size, k);
        const Eigen::VectorXd numeric =
            (Residuals(unit, {loss, kWidth}) - Residuals(-unit, {loss, kWidth})) / (2 * step);
        EXPECT_LT((numeric - J.col(k)).norm(), 1e-5 * J.col(k).norm()) << k;
      }
    }
  }
}

// The covariance of their errors, the common one included, is that of the identity.
TEST_F(MarkerRowsOfOneMarker, AreWhitened) {
  const NoiseModel alone = camera().noise;
  MarkerRows rows(camera(), kAll);
  rows.Load(ViewOf(bundle_, 0, 1), marker_, observations_, {});
  const Eigen::VectorXd before = rows.Residual();
  const Eigen::MatrixXd pose = rows.Pose();
  Eigen::Vector3d u;
  for (int i = 0; i < 3; ++i)
    u[i] = 1 / alone.OwnSigma(observations_[static_cast<size_t>(i)].assumed_sigma);
  const Matrix6d of_mean = rows.PoseInformationOfMean();
  const Eigen::MatrixXd sum =
      u[0] * pose.topRows<2>() + u[1] * pose.middleRows<2>(2) + u[2] * pose.bottomRows<2>();
  EXPECT_LT((of_mean - sum.transpose() * sum / u.squaredNorm()).norm(), 1e-9 * of_mean.norm());
  constexpr double kCommon = 0.25;
  camera().noise.common_sigma = kCommon;
  rows.Load(ViewOf(bundle_, 0, 1), marker_, observations_, {});
  const Eigen::Matrix3d C = Eigen::Matrix3d::Identity() + kCommon * kCommon * u * u.transpose();
  double chi_square = 0;
  for (int axis = 0; axis < 2; ++axis) {
    const Eigen::Vector3d r(before[axis], before[2 + axis], before[4 + axis]);
    chi_square += r.dot(C.inverse() * r);
  }
  EXPECT_NEAR(rows.Residual().squaredNorm() / chi_square, 1, 1e-9);
}

// Rows of losses under common noise have the squares that their own covariance gives.
TEST_F(MarkerRowsOfOneMarker, AreWhitenedAfterTheirLoss) {
  constexpr double kCommon = 0.15;
  observations_.front().seen.values[0] += 0.02;
  MarkerRows rows(camera(), kAll);
  rows.Load(ViewOf(bundle_, 0, 1), marker_, observations_, {});
  const Eigen::VectorXd own = rows.Residual();
  camera().noise.common_sigma = kCommon;
  for (const RobustLoss& loss : {RobustLoss{Loss::kHuber, kWidth, true},
                                 RobustLoss{Loss::kHuber, kWidth},
                                 RobustLoss{Loss::kCauchy, kWidth}}) {
    ASSERT_TRUE(rows.Load(ViewOf(bundle_, 0, 1), marker_, observations_, loss));
    Eigen::Vector3d u;
    Eigen::Matrix<double, 3, 2> r;
    for (int i = 0; i < 3; ++i) {
      const double assumed = observations_[static_cast<size_t>(i)].assumed_sigma;
      const double own_sigma = camera().noise.OwnSigma(assumed);
      const double s = own.segment<2>(2 * i).norm() * own_sigma / std::hypot(own_sigma, kCommon);
      const double rho = loss.loss == Loss::kCauchy
                             ? kWidth * kWidth * std::log1p(s * s / (kWidth * kWidth))
                         : s <= kWidth    ? s * s
                         : loss.reweights ? kWidth * s
                                          : 2 * kWidth * s - kWidth * kWidth;
      const double factor = std::sqrt(rho) / s;
      r.row(i) = factor * own.segment<2>(2 * i).transpose();
      u[i] = (loss.reweights ? factor : 1) / own_sigma;
    }
    const Eigen::Matrix3d C = Eigen::Matrix3d::Identity() + kCommon * kCommon * u * u.transpose();
    EXPECT_NEAR(rows.Residual().squaredNorm() / (r.transpose() * C.inverse() * r).trace(), 1, 1e-9);
  }
}

bool ProjectWithoutJacobian(const CameraModel& /*model*/,
                            const double* /*params*/,
                            const double* /*config*/,
                            const double* /*values*/,
                            const Eigen::Vector3d& /*p_cam*/,
                            double /*h*/,
                            const ProjectionOutput& /*out*/) {
  return false;
}

TEST_F(MarkerRowsOfOneMarker, CountWithoutDerivativesWhereOnlyTheseAreMissing) {
  // Memory that is not zero.
  MarkerRows rows(camera(), kAll);
  ASSERT_TRUE(rows.Load(ViewOf(bundle_, 0, 1), marker_, observations_, {}));
  const Eigen::VectorXd residual = rows.Residual();
  CameraModel model = *camera().model;
  model.functions.project_with_jacobian = ProjectWithoutJacobian;
  camera().model = &model;
  ASSERT_TRUE(rows.Load(ViewOf(bundle_, 0, 1), marker_, observations_, {}));
  ASSERT_EQ(rows.Count(), 6);
  EXPECT_LT((rows.Residual() - residual).norm(), 1e-9);
  EXPECT_EQ(rows.Params().norm() + rows.Extrinsics().norm(), 0);
  EXPECT_EQ(rows.Pose().norm() + rows.Position().norm(), 0);
  // Points behind the camera have neither.
  LinearisedView behind = ViewOf(bundle_, 0, 1);
  behind.T_camera_rig.t.z() -= 100;
  EXPECT_FALSE(rows.Load(behind, marker_, observations_, {}));
  EXPECT_EQ(rows.Count(), 0);
  MarkerRows residuals(camera(), {});
  EXPECT_FALSE(residuals.Load(behind, marker_, observations_, {}));
  EXPECT_EQ(residuals.Count(), 0);
}

// A model that projects the points of a view all at once has the rows that it has one by one.
TEST(MarkerRows, ArePreparedForAWholeView) {
  Bundle bundle = TrueBundle(MakeProblem(3, {.cameras = 2, .frames = 1, .noise = 0.3}));
  BundleCamera& camera = bundle.cameras[1];
  camera.model = &AddFormulaModel(
      "of-rows",
      YamlNode::Parse("{params: {k_1: {}, k_2: {}}, radius: theta*(1 + k_1*theta^2 + k_2*theta^4)}",
                      "of-rows"),
      "of-rows");
  ASSERT_NE(camera.model->functions.project_block, nullptr);
  const std::vector<double> known = camera.params;
  camera.params = {known[0], known[1], known[2], known[3], 0.01, -0.002};
  std::vector<BundleObservation> seen;
  std::ranges::copy_if(bundle.observations, std::back_inserter(seen), [](const auto& each) {
    return each.camera == 1;
  });
  ASSERT_GT(seen.size(), 20U);
  const LinearisedView view = ViewOf(bundle, 0, 1);
  MarkerRows prepared(camera, kAll), single(camera, kAll);
  prepared.Prepare(view, seen, bundle.markers);
  for (const BundleObservation& each : seen) {
    const Eigen::Vector3d p = bundle.markers[static_cast<size_t>(each.marker)].position;
    ASSERT_TRUE(prepared.Load(view, p, {&each, 1}, {}));
    ASSERT_TRUE(single.Load(view, p, {&each, 1}, {}));
    EXPECT_LT((prepared.Residual() - single.Residual()).norm(), 1e-9) << each.marker;
    EXPECT_LT((prepared.Params() - single.Params()).norm(), 1e-9 * single.Params().norm());
    EXPECT_LT((prepared.Pose() - single.Pose()).norm(), 1e-9 * single.Pose().norm());
    EXPECT_LT((prepared.Position() - single.Position()).norm(), 1e-9 * single.Position().norm());
  }
  // A point that does not project has no rows.
  std::vector<BundleMarker> markers = bundle.markers;
  const Eigen::Vector3d nowhere = Eigen::Vector3d::Constant(std::nan(""));
  markers[static_cast<size_t>(seen[1].marker)].position = nowhere;
  prepared.Prepare(view, seen, markers);
  EXPECT_FALSE(prepared.Load(view, nowhere, {&seen[1], 1}, {}));
  EXPECT_EQ(prepared.Count(), 0);
  // Without derivatives.
  MarkerRows residuals(camera, {});
  residuals.Prepare(view, seen, bundle.markers);
  const Eigen::Vector3d p = bundle.markers[static_cast<size_t>(seen[0].marker)].position;
  ASSERT_TRUE(residuals.Load(view, p, {seen.data(), 1}, {}));
  ASSERT_TRUE(single.Load(view, p, {seen.data(), 1}, {}));
  EXPECT_LT((residuals.Residual() - single.Residual()).norm(), 1e-9);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
