// SPDX-License-Identifier: Apache-2.0
//
// The normal equations of a bundle of targets with poses and jitter eliminated (Schur complement).
#pragma once

#include <Eigen/Core>
#include <vector>

#include "calib/adjust/layout.h"
#include "calib/adjust/reduced/states.h"
#include "calib/adjust/rows.h"

namespace plenocal::internal {

/// Loss and weights of the sum of squares that is minimised, beside what a bundle states.
struct Objective {
  RobustLoss loss;
  /// Per view, or empty: `JitterWeight`, which stays what it was before a solve.
  std::vector<Matrix6d> jitter_weights;
};
Objective ObjectiveOf(const Bundle& bundle, const RobustLoss& loss);

/// A state that is eliminated: the pose of a frame, or the jitter of a view.
struct EliminatedState {
  bool is_jitter = false;
  size_t index = 0;  ///< of the frame, or of the view (`BundleState::View`)
};

/// One camera's observations in one frame, reduced to the pose that it saw.
struct EliminatedView {
  size_t frame = 0, camera = 0;
  Matrix6d information = Matrix6d::Zero();           ///< E' E, of that pose
  Matrix6d information_of_means = Matrix6d::Zero();  ///< that of the means of markers
  ViewCharts charts = {};                            ///< by its states
  States::Id pose = 0, jitter = 0;                   ///< `jitter` where the bundle has it
};

struct ReducedEquations {
  /// Lower triangle of the normal matrix of the layout's unknowns, all in the charts about their
  /// present values, without priors of parameters. The last row is the gradient of half the sum of
  /// squares.
  Eigen::MatrixXd S;
  /// Diagonal of the matrix before poses were eliminated, whose rounding `S` has; of markers only
  /// their prior's part.
  Eigen::VectorXd diagonal;
  double squares = 0;     ///< the sum of squares of residuals, of priors of markers and of jitter
  bool complete = false;  ///< all used observations project
  States states;
  std::vector<EliminatedState> order;  ///< of the states
  std::vector<EliminatedView> views;   ///< where they are kept

  /// Moves poses and jitter of `bundle`, which are as they were at the elimination, by
  /// `States::Steps`.
  void MoveStates(const Eigen::VectorXd& step, double own_part, Bundle* bundle) const;
};

/// `damping`: `States::Leave`.
ReducedEquations EliminateFrames(const Bundle& bundle,
                                 const UnknownLayout& layout,
                                 const Objective& objective,
                                 double damping,
                                 const EliminationOptions& options);

/// `ReducedEquations::squares` alone; infinite where a used observation does not project.
double SumOfSquares(const Bundle& bundle, const Objective& objective);

}  // namespace plenocal::internal
