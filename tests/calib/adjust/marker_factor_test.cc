// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/reduced/marker_factor.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "tests/calib/random.h"

namespace plenocal::internal {
namespace TEST_FILE {

Eigen::MatrixXd Drawn(Eigen::Index rows, Eigen::Index columns, testing::Random* random) {
  return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return random->Uniform(-1, 1); });
}

// Blocks of a marker's position, and of it beside three numbers of a camera; columns that are added
// (distances) and taken away (poses).
TEST(MarkerFactor, SolvesBlocksWithAndWithoutColumns) {
  for (const Eigen::Index block : {3, 6}) {
    testing::Random random(7);
    const Eigen::Index size = 4 * block;
    Eigen::MatrixXd blocks = Eigen::MatrixXd::Zero(size, size);
    for (Eigen::Index i = 0; i < size; i += block) {
      const Eigen::MatrixXd root = Drawn(block, block, &random);
      blocks.block(i, i, block, block) =
          root * root.transpose() + 5 * Eigen::MatrixXd::Identity(block, block);
    }
    const Eigen::VectorXd damping = Eigen::VectorXd::Constant(size, 0.1);
    const Eigen::MatrixXd minus = 0.3 * Drawn(size, 5, &random);
    const Eigen::MatrixXd right = Drawn(size, 3, &random);
    const Eigen::Vector3d x(1, -2, 0.5);
    const Eigen::MatrixXd plus = 10 * Drawn(size, 2, &random);
    Eigen::MatrixXd whole = blocks + plus * plus.transpose() - minus * minus.transpose();
    whole.diagonal() += damping;
    MarkerFactor factor;
    factor.Compute(blocks, block, damping, plus, minus);
    const Eigen::MatrixXd root = factor.Root(right);
    const Eigen::MatrixXd expected = whole.inverse() * right;
    EXPECT_LT((root.transpose() * root - right.transpose() * expected).norm(), 1e-12);
    EXPECT_LT((factor.Solve(root * x) - expected * x).norm(), 1e-12);
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
