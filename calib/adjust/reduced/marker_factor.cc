// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/reduced/marker_factor.h"

#include <cmath>

#include "calib/base/linear_algebra.h"
#include "calib/kernels/row_products.h"

namespace plenocal::internal {

void MarkerFactor::Compute(const Eigen::Ref<const Eigen::MatrixXd>& matrix,
                           const Eigen::VectorXd& damping) {
  blocks_.clear();
  Eigen::MatrixXd damped = matrix;
  damped.diagonal() += damping;
  factor_.compute(damped);
}

void MarkerFactor::Compute(const Eigen::Ref<const Eigen::MatrixXd>& matrix,
                           Eigen::Index block,
                           const Eigen::VectorXd& damping,
                           const Eigen::MatrixXd& minus,
                           const Eigen::MatrixXd& plus) {
  blocks_.clear();
  for (Eigen::Index i = 0; i < matrix.rows(); i += block) {
    Eigen::MatrixXd damped = matrix.block(i, i, block, block);
    damped.diagonal() += damping.segment(i, block);
    blocks_.emplace_back(damped.llt().matrixL());
  }
  plus_.resize(matrix.rows(), 0);
  of_plus_.resize(0);
  Eigen::MatrixXd p = plus;
  if (p.cols() > 0) {
    Whiten(p);
    const SymmetricEigen axes = DecomposeSymmetric(Eigen::MatrixXd(p.transpose() * p));
    plus_ = p * axes.vectors;
    of_plus_ = axes.values.unaryExpr([](double e) {
      const double root = std::sqrt(1 + e);
      return 1 / (root * (1 + root));  // (1 - 1 / root) / e
    });
  }
  scaled_ = minus;
  Whiten(scaled_);
  Eigen::MatrixXd rest = Eigen::MatrixXd::Identity(minus.cols(), minus.cols());
  RowMajorMatrix rows = ZeroRows(minus.cols(), RoundUpToFour(minus.rows()));
  rows.topLeftCorner(minus.cols(), minus.rows()) = scaled_.transpose();
  AddRowProducts(-1, rows, &rest);
  factor_.compute(rest);
}

void MarkerFactor::Whiten(Eigen::Ref<Eigen::MatrixXd> B) const {
  Eigen::Index row = 0;
  for (const Eigen::MatrixXd& C : blocks_) {
    C.triangularView<Eigen::Lower>().solveInPlace(B.middleRows(row, C.rows()));
    row += C.rows();
  }
  if (plus_.cols() > 0) B -= plus_ * (of_plus_.asDiagonal() * (plus_.transpose() * B).eval());
}

void MarkerFactor::WhitenTransposed(Eigen::Ref<Eigen::VectorXd> b) const {
  if (plus_.cols() > 0) b -= plus_ * of_plus_.cwiseProduct(plus_.transpose() * b);
  Eigen::Index row = 0;
  for (const Eigen::MatrixXd& C : blocks_) {
    C.triangularView<Eigen::Lower>().transpose().solveInPlace(b.segment(row, C.rows()));
    row += C.rows();
  }
}

Eigen::MatrixXd MarkerFactor::Root(const Eigen::MatrixXd& right) const {
  if (blocks_.empty()) return factor_.matrixL().solve(right);
  Eigen::MatrixXd root(right.rows() + scaled_.cols(), right.cols());
  root.topRows(right.rows()) = right;
  Whiten(root.topRows(right.rows()));
  root.bottomRows(scaled_.cols()) =
      factor_.matrixL().solve(scaled_.transpose() * root.topRows(right.rows()));
  return root;
}

Eigen::VectorXd MarkerFactor::Solve(const Eigen::VectorXd& root) const {
  if (blocks_.empty()) return factor_.matrixU().solve(root);
  Eigen::VectorXd solution = root.head(scaled_.rows());
  solution += scaled_ * factor_.matrixU().solve(root.tail(scaled_.cols()));
  WhitenTransposed(solution);
  return solution;
}

}  // namespace plenocal::internal
