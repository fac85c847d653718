// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/reduced/states.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <vector>

#include "tests/calib/random.h"

namespace plenocal::internal {
namespace TEST_FILE {

// A trajectory: rows depend on two successive states and on five unknowns in common, and each state
// leaves after its last row.
class Trajectory : public ::testing::Test {
 protected:
  static constexpr int kStates = 40, kCommon = 5, kRows = 14;  // rows of a pair of states

  Trajectory() : states_(kCommon + 1, kCommon, {.keep_steps = true}) {
    testing::Random random(3);
    const int size = 6 * kStates + kCommon;
    whole_ = Eigen::MatrixXd::Zero(size, size);
    gradient_ = Eigen::VectorXd::Zero(size);
    S_ = Eigen::MatrixXd::Zero(kCommon + 1, kCommon + 1);
    for (int k = 0; k < kStates; ++k) {
      ids_.push_back(states_.Enter());
      if (k == 0) continue;
      for (int row = 0; row < kRows; ++row) AddRow(k, &random);
      states_.Leave(ids_[static_cast<size_t>(k) - 1], 0, &S_);
    }
    states_.Leave(ids_.back(), 0, &S_);
    states_.Flush(&S_);
    S_.topLeftCorner(kCommon, kCommon) += whole_.bottomRightCorner(kCommon, kCommon);
    S_.row(kCommon).head(kCommon) += gradient_.tail(kCommon).transpose();
  }

  // Of states k - 1 and k.
  void AddRow(int k, testing::Random* random) {
    Eigen::VectorXd J = Eigen::VectorXd::Zero(whole_.rows());
    J.segment<12>(6 * (k - 1)) =
        Eigen::VectorXd::NullaryExpr(12, [&] { return random->Gaussian(1); });
    J.tail<kCommon>() = Eigen::VectorXd::NullaryExpr(kCommon, [&] { return random->Gaussian(1); });
    const double residual = random->Gaussian(1);
    whole_ += J * J.transpose();
    gradient_ += residual * J;
    const States::Id before = ids_[static_cast<size_t>(k) - 1],
                     after = ids_[static_cast<size_t>(k)];
    const Vector6d a = J.segment<6>(6 * (k - 1)), b = J.segment<6>(6 * k);
    states_.Information(before, before) += a * a.transpose();
    states_.Information(after, before) += b * a.transpose();
    states_.Information(after, after) += b * b.transpose();
    Eigen::VectorXd other(kCommon + 1);
    other << J.tail<kCommon>(), residual;
    states_.Cross(before) += other * a.transpose();
    states_.Cross(after) += other * b.transpose();
  }

  States states_;
  std::vector<States::Id> ids_;
  Eigen::MatrixXd whole_, S_;
  Eigen::VectorXd gradient_;
};

TEST_F(Trajectory, LeavesTheEquationsOfTheOtherUnknowns) {
  const Eigen::Index states = 6 * kStates;
  const Eigen::MatrixXd solved =
      whole_.topLeftCorner(states, states).inverse() * whole_.topRightCorner(states, kCommon);
  const Eigen::MatrixXd expected = whole_.bottomRightCorner(kCommon, kCommon) -
                                   whole_.bottomLeftCorner(kCommon, states) * solved;
  const Eigen::MatrixXd found = S_.topLeftCorner(kCommon, kCommon).selfadjointView<Eigen::Lower>();
  EXPECT_LT((found - expected).norm(), 1e-10 * expected.norm());
  const Eigen::VectorXd gradient =
      gradient_.tail(kCommon) - solved.transpose() * gradient_.head(states);
  EXPECT_LT((S_.row(kCommon).head(kCommon).transpose() - gradient).norm(), 1e-10 * gradient.norm());
}

// One state with six and with five independent rows, on which one more unknown depends.
struct OneState {
  explicit OneState(int rows, bool keep_steps) : states(2, 1, {.keep_steps = keep_steps}) {
    testing::Random random(5);
    id = states.Enter();
    for (int row = 0; row < rows; ++row) {
      Vector6d J = random.Gaussians<6>(1);
      if (rows < 6) J[5] = 0;
      const Eigen::Vector2d other(random.Gaussian(1), random.Gaussian(1));  // and the residual
      H += J * J.transpose();
      C += other * J.transpose();
      states.Information(id, id) += J * J.transpose();
      states.Cross(id) += other * J.transpose();
    }
  }
  void Leave(double damping) {
    states.Leave(id, damping, &S);
    states.Flush(&S);
  }

  States states;
  States::Id id = 0;
  Matrix6d H = Matrix6d::Zero();
  Eigen::Matrix<double, 2, 6> C = Eigen::Matrix<double, 2, 6>::Zero();
  Eigen::MatrixXd S = Eigen::MatrixXd::Zero(2, 2);
};

TEST(OneState, IsDampedByAPartOfItsDiagonal) {
  OneState one(9, true);
  one.Leave(0.5);
  Matrix6d damped = one.H;
  damped.diagonal() *= 1.5;
  const Eigen::Matrix2d expected = -one.C * damped.inverse() * one.C.transpose();
  EXPECT_NEAR(one.S(0, 0), expected(0, 0), 1e-9);
  EXPECT_NEAR(one.S(1, 0), expected(1, 0), 1e-9);
  const Vector6d step = -damped.inverse() * one.C.transpose() * Eigen::Vector2d(0.3, 1);
  EXPECT_LT((one.states.Steps(Eigen::VectorXd::Constant(1, 0.3), 1)[0] - step).norm(), 1e-9);
  EXPECT_TRUE(one.states.IsDetermined(one.id));
}

TEST(OneState, WithoutInformationEnoughChangesNothingOrStepsALittle) {
  OneState without(5, false);
  without.Leave(0);
  EXPECT_EQ(without.S.norm(), 0);
  EXPECT_FALSE(without.states.IsDetermined(without.id));
  EXPECT_EQ(without.states.Covariance(without.id, without.id).norm(), 0);
  OneState kept(5, true);
  kept.Leave(0);
  EXPECT_TRUE(kept.states.IsDetermined(kept.id));
  // Along what the rows determine the step is theirs, along the sixth number none.
  const Vector6d found = kept.states.Steps(Eigen::VectorXd::Zero(1), 1)[0];
  Vector6d expected = Vector6d::Zero();
  expected.head<5>() =
      -kept.H.topLeftCorner<5, 5>().inverse() * kept.C.row(1).head<5>().transpose();
  EXPECT_LT((found - expected).norm(), 1e-3 * expected.norm());
  EXPECT_GT((found - expected).norm(), 1e-9 * expected.norm());
  OneState none(0, true);
  none.Leave(0);
  EXPECT_FALSE(none.states.IsDetermined(none.id));
  EXPECT_EQ(none.states.Steps(Eigen::VectorXd::Ones(1), 1)[0].norm(), 0);
}

TEST_F(Trajectory, HasRowsOfWhatTheEliminationTakesAway) {
  const Eigen::Index states = 6 * kStates;
  const Eigen::MatrixXd W = states_.RowsOfColumns(1, 3);
  ASSERT_EQ(W.rows(), 3);
  EXPECT_EQ(W.cols(), states);
  const Eigen::MatrixXd B = whole_.block(states + 1, 0, 3, states);
  const Eigen::MatrixXd taken = B * whole_.topLeftCorner(states, states).inverse() * B.transpose();
  EXPECT_LT((W * W.transpose() - taken).norm(), 1e-10 * taken.norm());
}

TEST_F(Trajectory, StepsToTheOptimum) {
  const Eigen::VectorXd expected = -whole_.inverse() * gradient_;
  const std::vector<Vector6d> steps = states_.Steps(expected.tail(kCommon), 1);
  for (int k = 0; k < kStates; ++k) {
    EXPECT_LT((steps[static_cast<size_t>(k)] - expected.segment<6>(6 * k)).norm(), 1e-10) << k;
  }
}

TEST_F(Trajectory, HasTheCovarianceOfItsStates) {
  states_.ComputeCovariances();
  const Eigen::MatrixXd expected = whole_.topLeftCorner(6 * kStates, 6 * kStates).inverse();
  for (int k = 0; k < kStates; ++k) {
    const States::Id id = ids_[static_cast<size_t>(k)];
    EXPECT_LT((states_.Covariance(id, id) - expected.block<6, 6>(6 * k, 6 * k)).norm(), 1e-10) << k;
    if (k == 0) continue;
    const States::Id before = ids_[static_cast<size_t>(k) - 1];
    EXPECT_LT((states_.Covariance(id, before) - expected.block<6, 6>(6 * k, 6 * (k - 1))).norm(),
              1e-10)
        << k;
    EXPECT_EQ(states_.Covariance(id, before), states_.Covariance(before, id).transpose());
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
