// SPDX-License-Identifier: Apache-2.0
#include "calib/kernels/row_products.h"

#include <gtest/gtest.h>

namespace plenocal {
namespace TEST_FILE {

TEST(RowProducts, AreTheRankUpdateOfTheLowerTriangle) {
  for (const Eigen::Index n : {1, 2, 3, 4, 5, 11, 12, 13, 50}) {
    RowMajorMatrix rows = ZeroRows(n, 18);
    rows.topLeftCorner(n, 18).setRandom();
    Eigen::MatrixXd S = Eigen::MatrixXd::Random(n, n);
    Eigen::MatrixXd expected = S;
    expected.selfadjointView<Eigen::Lower>().rankUpdate(rows.topLeftCorner(n, 18), -1);
    AddRowProducts(-1, rows, &S);
    EXPECT_LT((S - expected).cwiseAbs().maxCoeff(), 1e-13) << n;
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
