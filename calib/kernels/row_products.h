// SPDX-License-Identifier: Apache-2.0
//
// Products of rows of residuals, the inner loop of the normal equations.
#pragma once

#include <Eigen/Core>

namespace plenocal {

using RowMajorMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// A matrix of zeros with at least `rows` rows and a whole number of `AddRowProducts`' steps.
RowMajorMatrix ZeroRows(Eigen::Index rows, Eigen::Index columns);

/// S += factor B B' in the lower triangle, B the first S.rows() rows of `rows`, which `ZeroRows`
/// has made, and their first `columns` columns, a multiple of four. Eigen's `rankUpdate`, two to
/// three times as fast on processors with AVX2: Eigen is compiled for all x86-64.
void AddRowProducts(double factor,
                    const RowMajorMatrix& rows,
                    Eigen::Index columns,
                    Eigen::MatrixXd* S);
/// `AddRowProducts` with all columns.
inline void AddRowProducts(double factor, const RowMajorMatrix& rows, Eigen::MatrixXd* S) {
  AddRowProducts(factor, rows, rows.cols(), S);
}

inline Eigen::Index RoundUpToFour(Eigen::Index n) { return (n + 3) / 4 * 4; }

}  // namespace plenocal
