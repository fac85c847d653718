// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <vector>

namespace plenocal::internal {

/// Factor of the markers' part of the normal matrix that is left when poses are eliminated.
class MarkerFactor {
 public:
  /// `matrix`: its lower triangle, n x n.
  void Compute(const Eigen::MatrixXd& matrix);
  /// Of blocks - columns columns', `blocks` with 3 x 3 on its diagonal and nothing else, by the
  /// Woodbury identity: cheaper than `Compute` where there are fewer columns than rows.
  void Compute(const Eigen::MatrixXd& blocks, const Eigen::MatrixXd& columns);

  /// R, of rows n or more, with R' R = right' matrix^-1 right.
  [[nodiscard]] Eigen::MatrixXd Root(const Eigen::MatrixXd& right) const;
  /// matrix^-1 right x from R x, R the root of `right`.
  [[nodiscard]] Eigen::VectorXd Solve(const Eigen::VectorXd& root) const;

 private:
  Eigen::LLT<Eigen::MatrixXd> factor_;   // of the matrix, or of 1 - scaled_' scaled_
  std::vector<Eigen::Matrix3d> blocks_;  // lower triangular factors C of the blocks
  Eigen::MatrixXd scaled_;               // C^-1 columns
};

}  // namespace plenocal::internal
