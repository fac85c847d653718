// SPDX-License-Identifier: Apache-2.0
//
// The factor of the markers' part of the reduced normal matrix.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <vector>

namespace plenocal::internal {

/// Factor of the markers' part of the normal matrix that is left when poses are eliminated.
class MarkerFactor {
 public:
  /// `matrix`: its lower triangle, n x n; `damping` is added to its diagonal.
  void Compute(const Eigen::Ref<const Eigen::MatrixXd>& matrix, const Eigen::VectorXd& damping);
  /// Factors matrix - columns columns', where of `matrix` the blocks of 3 x 3 on its diagonal count
  /// and the rest is zero, by the Woodbury identity: cheaper where there are fewer columns than
  /// rows.
  void Compute(const Eigen::Ref<const Eigen::MatrixXd>& matrix,
               const Eigen::VectorXd& damping,
               const Eigen::MatrixXd& columns);

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
