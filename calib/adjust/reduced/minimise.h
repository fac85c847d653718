// SPDX-License-Identifier: Apache-2.0
//
// The back end of most adjustments: poses, jitter and markers are eliminated, and what is left, 7
// to some hundred unknowns, is solved by Levenberg and Marquardt's method.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "calib/adjust/priors.h"
#include "calib/adjust/reduced/elimination.h"
#include "calib/adjust/reduced/marker_factor.h"
#include "calib/adjust/solution.h"

namespace plenocal::internal {

/// A bundle of targets as a function of the unknowns of its cameras and targets (the head of
/// `layout`). Poses of frames, jitter and markers follow these: from the point of a linearisation
/// they take the step to the optimum of the residuals linearised there. So each point costs one
/// pass over the observations, and a linearisation one elimination whose blocks have sizes that are
/// known, which Ceres' own has not. Values do not depend on what was computed before.
class ReducedProblem {
 public:
  /// The normal equations at one point, and what the steps of markers and states follow from.
  struct Linearisation {
    BundleState state;  // of the point
    double squares = 0;
    ReducedEquations equations;
    Eigen::MatrixXd matrix = {};        // of the head, with priors
    Eigen::VectorXd gradient = {};      // of half the sum of squares
    Eigen::VectorXd diagonal = {};      // of the matrix before the elimination
    MarkerFactor markers = {};          // of their part
    Eigen::MatrixXd marker_roots = {};  // `MarkerFactor::Root` of their rows, and of their gradient
  };

  /// `bundle` is the workspace, at whose values all is evaluated; it must outlive this.
  ReducedProblem(const RobustLoss& loss, Bundle* bundle);

  /// The sum of squares; infinite outside the models' domains.
  [[nodiscard]] double Squares() const;
  /// Nothing outside the models' domains.
  [[nodiscard]] std::optional<Linearisation> Linearise() const;
  /// Moves the bundle from the point of a linearisation by `step` of the head. `own_part`: factor
  /// on the part of the step of states and markers that does not depend on `step`.
  void MoveFrom(const Linearisation& from, const Eigen::VectorXd& step, double own_part);
  /// The head of this is what steps change.
  [[nodiscard]] const UnknownLayout& Layout() const { return layout_; }

 private:
  void EliminateMarkers(bool separate, const Eigen::MatrixXd& plus, Linearisation* at) const;

  Bundle& bundle_;
  std::vector<bool> used_;  // per camera
  UnknownLayout layout_;
  Objective objective_;
};

/// `Adjust` by this back end. REQUIRES: no landmarks.
AdjustSummary MinimiseReduced(const AdjustOptions& options, Bundle* bundle);

}  // namespace plenocal::internal
