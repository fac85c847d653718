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
  /// Factors matrix + diag(damping) + plus plus' - minus minus', where of `matrix` the lower
  /// triangle counts, and there the blocks of `block` x `block` on its diagonal: by the Woodbury
  /// identity, which is cheaper where `minus` has fewer columns than rows. These are those of
  /// eliminated poses; where they are more, the matrix is one block and `minus` has no columns.
  /// `plus`: few columns, those of measured distances. REQUIRES: n is a multiple of `block`, and
  /// the blocks and the result are positive definite.
  void Compute(const Eigen::Ref<const Eigen::MatrixXd>& matrix,
               Eigen::Index block,
               const Eigen::VectorXd& damping,
               const Eigen::MatrixXd& plus,
               const Eigen::MatrixXd& minus);

  /// R, of rows n or more, with R' R = right' matrix^-1 right.
  [[nodiscard]] Eigen::MatrixXd Root(const Eigen::MatrixXd& right) const;
  /// matrix^-1 right x from R x, R the root of `right`.
  [[nodiscard]] Eigen::VectorXd Solve(const Eigen::VectorXd& root) const;

 private:
  // C^-1 B: C C' the blocks and plus plus'.
  void Whiten(Eigen::Ref<Eigen::MatrixXd> B) const;
  // (1 + plus_ plus_')^-1/2 B, in place.
  void TakePlus(Eigen::Ref<Eigen::MatrixXd> B) const;

  std::vector<Eigen::LLT<Eigen::MatrixXd>> blocks_;  // B B'; C = B (1 + plus_ plus_')^1/2
  Eigen::MatrixXd plus_;                             // B^-1 plus
  Eigen::MatrixXd less_;                             // 1 - plus_ less_ plus_' is the inverse root
  Eigen::MatrixXd scaled_;                           // C^-1 minus
  Eigen::LLT<Eigen::MatrixXd> rest_;                 // of 1 - scaled_' scaled_
};

}  // namespace plenocal::internal
