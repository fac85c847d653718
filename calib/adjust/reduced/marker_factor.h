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
  /// Factors matrix - minus minus' + plus plus', where of `matrix` the blocks of `block` x `block`
  /// on its diagonal count and the rest is zero, by the Woodbury identity: cheaper where there are
  /// fewer columns than rows. Eliminated poses are columns of `minus`; `plus` may be empty, or hold
  /// what ties markers together: measured distances, the scale of all. REQUIRES: n is a multiple of
  /// `block`, and the blocks and the result are positive definite.
  void Compute(const Eigen::Ref<const Eigen::MatrixXd>& matrix,
               Eigen::Index block,
               const Eigen::VectorXd& damping,
               const Eigen::MatrixXd& minus,
               const Eigen::MatrixXd& plus);

  /// R, of rows n or more, with R' R = right' matrix^-1 right.
  [[nodiscard]] Eigen::MatrixXd Root(const Eigen::MatrixXd& right) const;
  /// matrix^-1 right x from R x, R the root of `right`.
  [[nodiscard]] Eigen::VectorXd Solve(const Eigen::VectorXd& root) const;

 private:
  // T C^-1 B and C'^-1 T B: C C' the blocks, T the symmetric root of (1 + p p')^-1, p = C^-1 plus.
  void Whiten(Eigen::Ref<Eigen::MatrixXd> B) const;
  void WhitenTransposed(Eigen::Ref<Eigen::VectorXd> b) const;

  Eigen::LLT<Eigen::MatrixXd> factor_;   // of the matrix, or of 1 - scaled_' scaled_
  std::vector<Eigen::MatrixXd> blocks_;  // lower triangular C
  Eigen::MatrixXd scaled_;               // T C^-1 minus
  Eigen::MatrixXd plus_;                 // orthogonal columns of p
  Eigen::VectorXd of_plus_;              // T = 1 - plus_ diag(of_plus_) plus_'
};

}  // namespace plenocal::internal
