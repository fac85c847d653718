// SPDX-License-Identifier: Apache-2.0
#include "calib/base/linear_algebra.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <vector>

#include "calib/base/statistics.h"

namespace plenocal {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Vector<double, 6>;

// Column by column: the solver for matrices takes as long to compile as that for vectors, again.
template <typename Factor>
Eigen::MatrixXd SolveColumns(const Factor& factor, const Eigen::MatrixXd& B) {
  Eigen::MatrixXd X(B.rows(), B.cols());
  using Column = Eigen::Vector<double, Factor::MatrixType::RowsAtCompileTime>;
  for (Eigen::Index k = 0; k < B.cols(); ++k) X.col(k) = factor.solve(Column(B.col(k)));
  return X;
}

}  // namespace

SymmetricEigen DecomposeSymmetric(const Eigen::MatrixXd& A) {
  if (A.rows() == 0) return {};  // Eigen's solver does not take the empty matrix
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(A);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

SymmetricEigen3 DecomposeSymmetric(const Eigen::Matrix3d& A) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(A);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

Eigen::VectorXd SolveSymmetric(const Eigen::MatrixXd& A, const Eigen::VectorXd& b) {
  return A.ldlt().solve(b);
}

Eigen::MatrixXd SolveSymmetric(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B) {
  return SolveColumns(A.ldlt(), B);
}

Eigen::Vector3d SolveSymmetric(const Eigen::Matrix3d& A, const Eigen::Vector3d& b) {
  return A.ldlt().solve(b);
}

Vector6d SolveSymmetric(const Matrix6d& A, const Vector6d& b) { return A.ldlt().solve(b); }

Eigen::MatrixXd SolveSymmetric(const Matrix6d& A, const Eigen::MatrixXd& B) {
  return SolveColumns(A.ldlt(), B);
}

std::optional<Vector6d> SolvePositive(const Matrix6d& A, const Vector6d& b) {
  const Eigen::LLT<Matrix6d> factor(A);
  if (factor.info() != Eigen::Success) return std::nullopt;
  return factor.solve(b);
}

std::optional<Eigen::MatrixXd> SolvePositive(const Matrix6d& A, const Eigen::MatrixXd& B) {
  const Eigen::LLT<Matrix6d> factor(A);
  if (factor.info() != Eigen::Success) return std::nullopt;
  return SolveColumns(factor, B);
}

Eigen::MatrixXd Inverse(const Eigen::MatrixXd& A) { return A.inverse(); }

Matrix6d Inverse(const Matrix6d& A) { return Inverse(Eigen::MatrixXd(A)); }

Eigen::MatrixXd PseudoInverse(const Eigen::MatrixXd& A) {
  return A.completeOrthogonalDecomposition().pseudoInverse();
}

Eigen::MatrixXd LeastSquares(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B) {
  return A.completeOrthogonalDecomposition().solve(B);
}

Eigen::VectorXd LeastSquares(const Eigen::MatrixXd& A, const Eigen::VectorXd& b) {
  return LeastSquares(A, Eigen::MatrixXd(b));
}

Eigen::MatrixXd RobustLeastSquares(const Eigen::MatrixXd& A,
                                   const Eigen::MatrixXd& B,
                                   double medians) {
  constexpr int kRounds = 10;
  Eigen::MatrixXd X = LeastSquares(A, B);
  for (int round = 1; round < kRounds; ++round) {
    const Eigen::ArrayXd lengths = (A * X - B).rowwise().norm();
    const double width = medians * Median(std::vector<double>(lengths.begin(), lengths.end()));
    if (!(width > 0)) break;
    const Eigen::VectorXd roots = (1 + (lengths / width).square()).rsqrt();
    X = LeastSquares(roots.asDiagonal() * A, Eigen::MatrixXd(roots.asDiagonal() * B));
  }
  return X;
}

Eigen::Matrix3d NearestRotation(const Eigen::Matrix3d& M) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(M, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Vector3d signs(1, 1, (svd.matrixU() * svd.matrixV().transpose()).determinant());
  return svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
}

Eigen::Matrix3d RotationBetween(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  // Two half-turns: about `from`, then about the direction in the middle of both, which for
  // opposite directions is any at right angles.
  const Eigen::Vector3d a = from.normalized(), sum = a + to.normalized();
  constexpr double kOpposite = 1e-9;
  const Eigen::Vector3d middle = sum.norm() < kOpposite ? a.unitOrthogonal() : sum.normalized();
  const auto half_turn = [](const Eigen::Vector3d& axis) -> Eigen::Matrix3d {
    return 2 * axis * axis.transpose() - Eigen::Matrix3d::Identity();
  };
  return half_turn(middle) * half_turn(a);
}

}  // namespace plenocal
