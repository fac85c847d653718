// SPDX-License-Identifier: Apache-2.0
//
// The models among which the best one is, by their losses on held-out frames (Hansen, Lunde and
// Nason, The model confidence set, Econometrica 79, 2011).
#pragma once

#include <Eigen/Core>
#include <vector>

namespace plenocal {

/// Level at which a model leaves the set.
inline constexpr double kOutsideConfidenceSet = 0.1;

/// p-value of each column of `losses` (frames x models): the set of level 1 - a has the models whose
/// value is at least a. The worst model is taken away time and again; its value is the probability
/// of so large a distance from the mean of the others if all were equal, by a bootstrap over frames,
/// and at least that of the models before it. `folds`: parts in which the frames were held out,
/// whose training sets overlap (as in `HeldOutScores`).
std::vector<double> ConfidenceSetProbabilities(const Eigen::MatrixXd& losses, size_t folds);

}  // namespace plenocal
