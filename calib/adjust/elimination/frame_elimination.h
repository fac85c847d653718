// SPDX-License-Identifier: Apache-2.0
//
// The normal equations of a bundle of targets with poses and jitter eliminated (Schur complement).
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "calib/adjust/elimination/unknown_layout.h"
#include "calib/adjust/robust_rows.h"

namespace plenocal::internal {

/// One camera's observations in one frame, reduced to the target pose.
struct ReducedView {
  size_t camera = 0;
  Matrix6d information = Matrix6d::Zero();  ///< of the pose that the camera saw, E' E
  Matrix6d of_means = Matrix6d::Zero();     ///< that of the means of markers
  /// With jitter about the frame's pose, of information W' W = Q: W and (E' E + Q)^-1.
  Matrix6d W = Matrix6d::Zero();
  Matrix6d jitter_covariance = Matrix6d::Zero();
};

/// Covariance of a frame's pose, all unknowns of the layout fixed, and the frame's views.
using VisitFrame = std::function<void(
    size_t frame, const Matrix6d& pose_covariance, std::span<const ReducedView> views)>;

/// Loss and weights of the sum of squares that is minimised, beside what a bundle states.
struct Objective {
  RobustLoss loss;
  /// Per view, or empty: `JitterWeight`, which stays what it was before a solve.
  std::vector<Matrix6d> jitter_weights;
};
Objective ObjectiveOf(const Bundle& bundle, const RobustLoss& loss);

struct EliminationOptions {
  /// Added to each pose's information as a part of its diagonal.
  double damping = 0;
  /// Keeps what `PoseSteps` needs: 48 bytes a frame and unknown.
  bool keep_steps = false;
  /// Leaves the markers' part of `S` as it is before poses are eliminated: blocks of 3 x 3. What
  /// the elimination takes away from it follows from `PoseSteps::MarkerColumns`. REQUIRES:
  /// keep_steps.
  bool separate_markers = false;
  VisitFrame visit = {};  ///< if set, called after each frame
};

/// The steps of poses and jitter to their optimum.
class PoseSteps {
 public:
  virtual ~PoseSteps() = default;
  /// Moves poses and jitter of `bundle`, which are as they were at the elimination, to the optimum
  /// of the linearised residuals when the unknowns of the layout change by `step`.
  /// `line_search_factor`: on the part of their steps that does not depend on `step`.
  virtual void Apply(const Eigen::VectorXd& step,
                     double line_search_factor,
                     Bundle* bundle) const = 0;
  /// W of the markers' rows: the elimination takes W W' away from their block.
  [[nodiscard]] virtual Eigen::MatrixXd MarkerColumns() const = 0;
};

struct ReducedEquations {
  /// Lower triangle of the normal matrix of the layout's unknowns, all in the charts about their
  /// present values, without priors of parameters. The last row is the gradient of half the sum of
  /// squares.
  Eigen::MatrixXd S;
  /// Diagonal of the matrix before poses were eliminated, whose rounding `S` has.
  Eigen::VectorXd diagonal;
  double squares = 0;     ///< the sum of squares of residuals, of priors of markers and of jitter
  bool complete = false;  ///< all used observations project
  std::unique_ptr<PoseSteps> steps;  ///< where they are kept
};

ReducedEquations EliminateFrames(const Bundle& bundle,
                                 const UnknownLayout& layout,
                                 const Objective& objective,
                                 const EliminationOptions& options);

/// `ReducedEquations::squares` alone; infinite where a used observation does not project.
double SumOfSquares(const Bundle& bundle, const Objective& objective);

}  // namespace plenocal::internal
