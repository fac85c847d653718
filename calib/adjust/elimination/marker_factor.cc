// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/elimination/marker_factor.h"

#include <cstddef>

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
                           const Eigen::VectorXd& damping,
                           const Eigen::MatrixXd& columns) {
  blocks_.clear();
  scaled_ = columns;
  for (Eigen::Index i = 0; i < matrix.rows(); i += 3) {
    Eigen::Matrix3d block = matrix.block<3, 3>(i, i);
    block.diagonal() += damping.segment<3>(i);
    const Eigen::LLT<Eigen::Matrix3d> factor(block);
    blocks_.emplace_back(factor.matrixL());
    blocks_.back().triangularView<Eigen::Lower>().solveInPlace(scaled_.middleRows<3>(i));
  }
  Eigen::MatrixXd rest = Eigen::MatrixXd::Identity(columns.cols(), columns.cols());
  RowMajorMatrix rows = ZeroRows(columns.cols(), RoundUpToFour(columns.rows()));
  rows.topLeftCorner(columns.cols(), columns.rows()) = scaled_.transpose();
  AddRowProducts(-1, rows, &rest);
  factor_.compute(rest);
}

Eigen::MatrixXd MarkerFactor::Root(const Eigen::MatrixXd& right) const {
  if (blocks_.empty()) return factor_.matrixL().solve(right);
  Eigen::MatrixXd root(right.rows() + scaled_.cols(), right.cols());
  auto of_blocks = root.topRows(right.rows());
  of_blocks = right;
  for (size_t b = 0; b < blocks_.size(); ++b) {
    blocks_[b].triangularView<Eigen::Lower>().solveInPlace(
        of_blocks.middleRows<3>(3 * static_cast<Eigen::Index>(b)));
  }
  root.bottomRows(scaled_.cols()) = factor_.matrixL().solve(scaled_.transpose() * of_blocks);
  return root;
}

Eigen::VectorXd MarkerFactor::Solve(const Eigen::VectorXd& root) const {
  if (blocks_.empty()) return factor_.matrixU().solve(root);
  const Eigen::Index rows = scaled_.rows();
  Eigen::VectorXd solution = root.head(rows);
  solution += scaled_ * factor_.matrixU().solve(root.tail(scaled_.cols()));
  for (size_t b = 0; b < blocks_.size(); ++b) {
    blocks_[b].transpose().triangularView<Eigen::Upper>().solveInPlace(
        solution.segment<3>(3 * static_cast<Eigen::Index>(b)));
  }
  return solution;
}

}  // namespace plenocal::internal
