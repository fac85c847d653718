// SPDX-License-Identifier: Apache-2.0
//
// Eigen's decompositions behind plain functions. A source that instantiates one of them itself
// takes 2 to 8 seconds longer to compile (GCC 12, -O3), so they are compiled here, once.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>

namespace plenocal {

/// Eigenvalues of a symmetric matrix, ascending, and unit eigenvectors as columns in the same
/// order.
struct SymmetricEigen {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
struct SymmetricEigen3 {
  Eigen::Vector3d values;
  Eigen::Matrix3d vectors;
};

/// Householder tridiagonalisation and QR iteration; only the lower triangle of A is read. A may be
/// empty.
SymmetricEigen DecomposeSymmetric(const Eigen::MatrixXd& A);
SymmetricEigen3 DecomposeSymmetric(const Eigen::Matrix3d& A);

/// x with A x = b for a symmetric, semidefinite A (pivoted LDL'). Not finite where A is singular
/// beyond rounding.
Eigen::VectorXd SolveSymmetric(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);
Eigen::MatrixXd SolveSymmetric(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);
Eigen::Vector3d SolveSymmetric(const Eigen::Matrix3d& A, const Eigen::Vector3d& b);
Eigen::Vector<double, 6> SolveSymmetric(const Eigen::Matrix<double, 6, 6>& A,
                                        const Eigen::Vector<double, 6>& b);
Eigen::MatrixXd SolveSymmetric(const Eigen::Matrix<double, 6, 6>& A, const Eigen::MatrixXd& B);

/// x with A x = b for a symmetric, positive definite A (Cholesky's LL'); empty if A is not positive
/// definite.
std::optional<Eigen::Vector<double, 6>> SolvePositive(const Eigen::Matrix<double, 6, 6>& A,
                                                      const Eigen::Vector<double, 6>& b);
std::optional<Eigen::MatrixXd> SolvePositive(const Eigen::Matrix<double, 6, 6>& A,
                                             const Eigen::MatrixXd& B);

/// By LU with partial pivoting; not finite where A is singular.
Eigen::MatrixXd Inverse(const Eigen::MatrixXd& A);
Eigen::Matrix<double, 6, 6> Inverse(const Eigen::Matrix<double, 6, 6>& A);

/// Moore and Penrose's, by a complete orthogonal decomposition.
Eigen::MatrixXd PseudoInverse(const Eigen::MatrixXd& A);
/// The X of least norm among those of least |A X - B|, by the same decomposition.
Eigen::MatrixXd LeastSquares(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);
Eigen::VectorXd LeastSquares(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);
/// X of least squares with Cauchy's weights of the rows of A X - B, whose width is `medians` times
/// their median length.
Eigen::MatrixXd RobustLeastSquares(const Eigen::MatrixXd& A,
                                   const Eigen::MatrixXd& B,
                                   double medians);

/// The rotation nearest to M in the Frobenius norm (singular value decomposition; determinant +1).
Eigen::Matrix3d NearestRotation(const Eigen::Matrix3d& M);
/// The rotation by the smallest angle that maps the direction `from` to the direction `to`.
Eigen::Matrix3d RotationBetween(const Eigen::Vector3d& from, const Eigen::Vector3d& to);

}  // namespace plenocal
