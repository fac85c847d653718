// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/reduced/marker_factor.h"

#include "calib/base/linear_algebra.h"
#include "calib/kernels/row_products.h"

namespace plenocal::internal {

void MarkerFactor::Compute(const Eigen::Ref<const Eigen::MatrixXd>& matrix,
                           Eigen::Index block,
                           const Eigen::VectorXd& damping,
                           const Eigen::MatrixXd& plus,
                           const Eigen::MatrixXd& minus) {
  blocks_.clear();
  for (Eigen::Index i = 0; i < matrix.rows(); i += block) {
    Eigen::MatrixXd damped = matrix.block(i, i, block, block);
    damped.diagonal() += damping.segment(i, block);
    blocks_.emplace_back(damped);
  }
  plus_.resize(matrix.rows(), 0);
  Eigen::MatrixXd whitened = plus;
  Whiten(whitened);
  plus_ = std::move(whitened);
  const SymmetricEigen spectrum = DecomposeSymmetric(Eigen::MatrixXd(plus_.transpose() * plus_));
  const Eigen::VectorXd root = (spectrum.values.cwiseMax(0).array() + 1).sqrt();
  // (1 - 1 / sqrt(1 + l)) / l
  less_ = spectrum.vectors * (root.array() * (root.array() + 1)).inverse().matrix().asDiagonal() *
          spectrum.vectors.transpose();
  scaled_ = minus;
  Whiten(scaled_);
  Eigen::MatrixXd rest = Eigen::MatrixXd::Identity(minus.cols(), minus.cols());
  RowMajorMatrix rows = ZeroRows(minus.cols(), RoundUpToFour(minus.rows()));
  rows.topLeftCorner(minus.cols(), minus.rows()) = scaled_.transpose();
  AddRowProducts(-1, rows, &rest);
  rest_.compute(rest);
}

void MarkerFactor::Whiten(Eigen::Ref<Eigen::MatrixXd> B) const {
  if (B.size() == 0) return;
  Eigen::Index row = 0;
  for (const Eigen::LLT<Eigen::MatrixXd>& block : blocks_) {
    auto part = B.middleRows(row, block.rows());
    block.matrixL().solveInPlace(part);
    row += block.rows();
  }
  TakePlus(B);
}

void MarkerFactor::TakePlus(Eigen::Ref<Eigen::MatrixXd> B) const {
  if (plus_.cols() > 0) B -= plus_ * (less_ * (plus_.transpose() * B)).eval();
}

Eigen::MatrixXd MarkerFactor::Root(const Eigen::MatrixXd& right) const {
  Eigen::MatrixXd root(right.rows() + scaled_.cols(), right.cols());
  root.topRows(right.rows()) = right;
  Whiten(root.topRows(right.rows()));
  root.bottomRows(scaled_.cols()) =
      rest_.matrixL().solve(scaled_.transpose() * root.topRows(right.rows()));
  return root;
}

Eigen::VectorXd MarkerFactor::Solve(const Eigen::VectorXd& root) const {
  Eigen::VectorXd solution = root.head(scaled_.rows());
  solution += scaled_ * rest_.matrixU().solve(root.tail(scaled_.cols()));
  TakePlus(solution);
  Eigen::Index row = 0;
  for (const Eigen::LLT<Eigen::MatrixXd>& block : blocks_) {
    auto part = solution.segment(row, block.rows());
    block.matrixU().solveInPlace(part);
    row += block.rows();
  }
  return solution;
}

}  // namespace plenocal::internal
