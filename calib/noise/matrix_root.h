// SPDX-License-Identifier: Apache-2.0
//
// Roots of a symmetric, positive semidefinite matrix, by the eigenvalues of that with unit
// diagonal: variances of different units are up to 1e24 apart (f_L and A_1 of a plenoptic camera),
// more than eigenvalues of one matrix can be told from zero.
#pragma once

#include <Eigen/Core>

#include "calib/base/linear_algebra.h"

namespace plenocal {

/// Eigenvalues and eigenvectors of S V S, S the diagonal matrix of `scale` by which the diagonal
/// becomes 1 (or stays 0).
struct UnitSpectrum {
  Eigen::VectorXd scale;
  SymmetricEigen eigen;

  explicit UnitSpectrum(const Eigen::MatrixXd& V);
};

/// N with N N' = V, square.
Eigen::MatrixXd Root(const Eigen::MatrixXd& V);

/// N with N N' the inverse of V where it has one: as many columns as the matrix with unit diagonal
/// has eigenvalues above 1e-10.
Eigen::MatrixXd InverseRoot(const Eigen::MatrixXd& V);

}  // namespace plenocal
