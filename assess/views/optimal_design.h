// SPDX-License-Identifier: Apache-2.0
//
// How far any choice from a set of views could lower a mean squared error: the bound of a convex
// (A-optimal) design (docs/suggest.md, "The bound").
#pragma once

#include <Eigen/Core>

namespace plenocal {

/// The upper triangle of a symmetric matrix as one column, and its inverse.
Eigen::VectorXd Packed(const Eigen::MatrixXd& symmetric);
/// The same with entries off the diagonal twice: its product with `Packed` of another is the trace
/// of both matrices' product.
Eigen::VectorXd PackedTwice(const Eigen::MatrixXd& symmetric);
Eigen::MatrixXd Unpacked(const Eigen::VectorXd& packed);

/// Numbers of views, not whole, that lower f = tr(M S^-1) most, S = S_0 + sum_i w_i D_i.
struct OptimalDesign {
  Eigen::VectorXd weights;     ///< w, per view; their sum is the number of views
  Eigen::MatrixXd covariance;  ///< S^-1
  Eigen::MatrixXd slope;       ///< S^-1 M S^-1; tr(slope D) is the loss of f per view D
  double trace = 0;            ///< f
  double of_so_far = 0;        ///< tr(slope S_0)
  double steepest = 0;         ///< the largest loss per view

  /// No `count` views, whole or not, have a smaller f than f^2 / (of_so_far + count * steepest).
  [[nodiscard]] double LeastTrace(double count) const {
    return trace * trace / (of_so_far + count * steepest);
  }
  /// Part of f by which the design may be above the best one.
  [[nodiscard]] double Gap(double count) const { return 1 - LeastTrace(count) / trace; }
  /// No fewer views than these, whole or not, have an f of `goal`; infinite where no number has.
  [[nodiscard]] double FewestViews(double goal) const;
};

/// Solves for at most `count` views of the set, until `trace` is within 0.3 % of `LeastTrace`,
/// which is a bound even before. `views`: packed information, one column a view. `start`: weights
/// of an earlier solution, or empty.
OptimalDesign SolveDesign(const Eigen::MatrixXd& M,
                          const Eigen::MatrixXd& so_far,
                          const Eigen::Ref<const Eigen::MatrixXd>& views,
                          double count,
                          const Eigen::VectorXd& start);

}  // namespace plenocal
