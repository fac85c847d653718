// SPDX-License-Identifier: Apache-2.0
#include "calib/kernels/row_products.h"

#include "calib/kernels/processors.h"

namespace plenocal {
namespace {

using Four = double __attribute__((vector_size(32), aligned(8), may_alias));

// As many sums at once as there are registers for.
constexpr Eigen::Index kTileRows = 4, kTileColumns = 3;

Eigen::Index RoundUp(Eigen::Index n, Eigen::Index step) { return (n + step - 1) / step * step; }

PLENOCAL_FOR_EACH_PROCESSOR
void Add(double factor,
         const double* rows,
         Eigen::Index width,
         Eigen::Index used,
         Eigen::Index n,
         double* S) {
  for (Eigen::Index column = 0; column < n; column += kTileColumns) {
    for (Eigen::Index row = column - column % kTileRows; row < n; row += kTileRows) {
      Four sums[kTileRows][kTileColumns] = {};
      for (Eigen::Index i = 0; i < used; i += 4) {
        for (Eigen::Index r = 0; r < kTileRows; ++r) {
          for (Eigen::Index c = 0; c < kTileColumns; ++c) {
            sums[r][c] += *reinterpret_cast<const Four*>(rows + (row + r) * width + i) *
                          *reinterpret_cast<const Four*>(rows + (column + c) * width + i);
          }
        }
      }
      for (Eigen::Index c = 0; c < kTileColumns; ++c) {
        for (Eigen::Index r = 0; r < kTileRows; ++r) {
          if (row + r >= n || column + c >= n || row + r < column + c) continue;
          const Four& sum = sums[r][c];
          S[(column + c) * n + row + r] += factor * ((sum[0] + sum[2]) + (sum[1] + sum[3]));
        }
      }
    }
  }
}

}  // namespace

RowMajorMatrix ZeroRows(Eigen::Index rows, Eigen::Index columns) {
  return RowMajorMatrix::Zero(RoundUp(rows, kTileRows * kTileColumns), RoundUpToFour(columns));
}

void AddRowProducts(double factor,
                    const RowMajorMatrix& rows,
                    Eigen::Index columns,
                    Eigen::MatrixXd* S) {
  Add(factor, rows.data(), rows.cols(), columns, S->rows(), S->data());
}

}  // namespace plenocal
