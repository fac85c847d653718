// SPDX-License-Identifier: Apache-2.0
#include "calib/camera/rigid_transform.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/calib/random.h"

namespace plenocal {
namespace TEST_FILE {

constexpr double kPi = std::numbers::pi;
// A handful of roundings of numbers of size 1.
constexpr double kExact = 1e-14;
// Near |w| = pi the logarithm divides by sin(|w|), or takes a square root of what is left of it.
constexpr double kNearPi = 1e-7;
// Central differences with steps of 1e-5: truncation 1e-10, rounding 1e-11, times the sizes here.
constexpr double kStep = 1e-5;
constexpr double kDerivative = 1e-8;

std::vector<Eigen::Vector3d> Axes() {
  std::vector<Eigen::Vector3d> axes{Eigen::Vector3d::UnitX(),
                                    Eigen::Vector3d::UnitY(),
                                    Eigen::Vector3d::UnitZ(),
                                    -Eigen::Vector3d::UnitZ(),
                                    Eigen::Vector3d(1, -1, 0).normalized()};
  testing::Random random(7);
  for (int i = 0; i < 20; ++i) axes.push_back(random.Direction());
  return axes;
}

const std::vector<double> kAngles{0, 1e-300, 1e-20, 1e-9, 1e-8, 1e-5, 1e-3, 0.1, 1, 2, 3, 3.1};

TEST(ExpRotation, TurnsXToYAboutZ) {
  const Eigen::Matrix3d R = ExpRotation(Eigen::Vector3d(0, 0, kPi / 2));
  EXPECT_LT((R * Eigen::Vector3d::UnitX() - Eigen::Vector3d::UnitY()).norm(), kExact);
}

TEST(ExpRotation, IsARotationForEveryVector) {
  for (const Eigen::Vector3d& axis : Axes()) {
    for (double angle : {0.0, 1e-12, 1e-4, 0.3, kPi, 4.0, 2 * kPi, 100.0}) {
      const Eigen::Matrix3d R = ExpRotation(angle * axis);
      EXPECT_LT((R * R.transpose() - Eigen::Matrix3d::Identity()).norm(), kExact);
      EXPECT_GT(R.determinant(), 0);
    }
  }
}

TEST(LogRotation, InvertsExpRotation) {
  for (const Eigen::Vector3d& axis : Axes()) {
    for (const double angle : kAngles) {
      const Eigen::Vector3d w = angle * axis;
      const double tolerance = kExact * (1 + 10 / (kPi - angle));
      EXPECT_LT((LogRotation(ExpRotation(w)) - w).norm(), tolerance) << w.transpose();
    }
  }
}

TEST(LogRotation, KeepsSmallAnglesToTheirOwnPrecision) {
  for (const Eigen::Vector3d& axis : Axes()) {
    for (const double angle : {1e-100, 1e-12, 1e-9, 1e-6}) {
      const Eigen::Vector3d w = angle * axis;
      EXPECT_LT((LogRotation(ExpRotation(w)) - w).norm(), 1e-6 * angle) << w.transpose();
    }
  }
}

TEST(LogRotation, HoldsNearAndAtHalfATurn) {
  for (const Eigen::Vector3d& axis : Axes()) {
    for (const double gap : {0.0, 1e-16, 1e-12, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2}) {
      for (const double sign : {-1.0, 1.0}) {
        const Eigen::Matrix3d R = ExpRotation((kPi + sign * gap) * axis);
        const Eigen::Vector3d w = LogRotation(R);
        EXPECT_LE(w.norm(), kPi + kExact);
        EXPECT_LT((ExpRotation(w) - R).norm(), kNearPi) << gap << " from pi";
      }
    }
  }
}

TEST(LeftJacobian, IsTheDerivativeOfTheRotation) {
  for (const Eigen::Vector3d& axis : Axes()) {
    for (const double angle : kAngles) {
      const Eigen::Vector3d w = angle * axis;
      const Eigen::Matrix3d J = LeftJacobian(w);
      for (int i = 0; i < 3; ++i) {
        const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(i);
        const Eigen::Vector3d numeric =
            (LogRotation(ExpRotation(w + step) * ExpRotation(w).transpose()) -
             LogRotation(ExpRotation(w - step) * ExpRotation(w).transpose())) /
            (2 * kStep);
        EXPECT_LT((J.col(i) - numeric).norm(), kDerivative) << w.transpose();
      }
    }
  }
}

TEST(RigidTransform, ComposesAndInverts) {
  const RigidTransform T_a_b{ExpRotation({0.1, -0.5, 2}), {1, 2, 3}};
  const RigidTransform T_b_c{ExpRotation({-1, 0.2, 0.3}), {-4, 0.5, 0}};
  const Eigen::Vector3d p_c(0.3, -7, 2);
  EXPECT_LT(((T_a_b * T_b_c) * p_c - T_a_b * (T_b_c * p_c)).norm(), 100 * kExact);
  EXPECT_LT((T_a_b.Inverse() * (T_a_b * p_c) - p_c).norm(), 100 * kExact);
}

TEST(Exp, PutsTheTranslationalPartFirst) {
  Vector6d xi;
  xi << 1, 2, 3, 0, 0, 0;
  EXPECT_EQ(Exp(xi).t, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(Exp(xi).R, Eigen::Matrix3d::Identity());
}

// exp(xi^) = sum xi^^k / k!, as docs/conventions.md defines it.
TEST(Exp, IsTheMatrixExponential) {
  for (const Eigen::Vector3d& axis : Axes()) {
    for (const double angle : kAngles) {
      Vector6d xi;
      xi << 0.3, -1.2, 0.7, angle * axis;
      Eigen::Matrix4d hat = Eigen::Matrix4d::Zero();
      hat.topLeftCorner<3, 3>() = Hat(xi.tail<3>());
      hat.topRightCorner<3, 1>() = xi.head<3>();
      Eigen::Matrix4d sum = Eigen::Matrix4d::Identity(), term = sum;
      for (int k = 1; k < 60; ++k) {
        term = term * hat / k;
        sum += term;
      }
      EXPECT_LT((Exp(xi).R - sum.topLeftCorner<3, 3>()).norm(), 100 * kExact) << angle;
      EXPECT_LT((Exp(xi).t - sum.topRightCorner<3, 1>()).norm(), 100 * kExact) << angle;
    }
  }
}

TEST(Log, InvertsExp) {
  for (const Eigen::Vector3d& axis : Axes()) {
    for (const double angle : kAngles) {
      Vector6d xi;
      xi << 0.3, -1.2, 0.7, angle * axis;
      EXPECT_LT((Log(Exp(xi)) - xi).norm(), 10 * kExact * (1 + 10 / (kPi - angle))) << angle;
    }
  }
}

TEST(Log, HoldsNearHalfATurn) {
  for (const Eigen::Vector3d& axis : Axes()) {
    for (const double gap : {0.0, 1e-12, 1e-8, 1e-5, 1e-3}) {
      const RigidTransform T{ExpRotation((kPi - gap) * axis), {0.3, -1.2, 0.7}};
      const RigidTransform again = Exp(Log(T));
      EXPECT_LT((again.R - T.R).norm(), kNearPi) << gap;
      EXPECT_LT((again.t - T.t).norm(), 10 * kNearPi) << gap;
    }
  }
}

TEST(Retract, TurnsFromTheLeftAndMovesTheOriginAlone) {
  const RigidTransform T{ExpRotation({0.1, -0.5, 2}), {1, 2, 3}};
  Vector6d delta;
  delta << 0.1, 0.2, 0.3, 0.4, -0.5, 0.6;
  const RigidTransform moved = Retract(T, delta);
  EXPECT_LT((moved.R - ExpRotation(delta.tail<3>()) * T.R).norm(), kExact);
  EXPECT_LT((moved.t - (T.t + delta.head<3>())).norm(), kExact);
  EXPECT_EQ(Retract(T, Vector6d::Zero()).R, T.R);
}

TEST(LogJacobian, IsTheDerivativeOfTheLogarithmInTheChart) {
  for (const Eigen::Vector3d& axis : Axes()) {
    for (const double angle : kAngles) {
      const RigidTransform T{ExpRotation(angle * axis), {0.3, -1.2, 0.7}};
      const Matrix6d J = LogJacobian(T);
      // Beyond 3 rad the fourth derivatives of the logarithm grow with 1 / (2 pi - angle) only.
      for (int i = 0; i < 6; ++i) {
        // A step must not carry the rotation past half a turn.
        const Vector6d step = kStep * Vector6d::Unit(i);
        const Vector6d numeric = (Log(Retract(T, step)) - Log(Retract(T, -step))) / (2 * kStep);
        EXPECT_LT((J.col(i) - numeric).norm(), 10 * kDerivative) << angle << ", column " << i;
      }
    }
  }
}

TEST(InverseLogJacobian, IsTheDerivativeOfTheInversesLogarithmInTheChart) {
  for (const Eigen::Vector3d& axis : Axes()) {
    for (const double angle : {0.0, 1e-5, 0.1, 1.0, 2.0, 3.0}) {
      const RigidTransform T{ExpRotation(angle * axis), {0.3, -1.2, 0.7}};
      const auto log_of_inverse = [&](const Vector6d& step) {
        return Log(Retract(T, step).Inverse());
      };
      const Matrix6d J = InverseLogJacobian(T);
      for (int i = 0; i < 6; ++i) {
        const Vector6d step = kStep * Vector6d::Unit(i);
        const Vector6d numeric = (log_of_inverse(step) - log_of_inverse(-step)) / (2 * kStep);
        EXPECT_LT((J.col(i) - numeric).norm(), 10 * kDerivative) << angle << ", column " << i;
      }
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
