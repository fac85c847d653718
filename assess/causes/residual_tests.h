// SPDX-License-Identifier: Apache-2.0
//
// Parts that tests for causes share: the residuals of a camera, a step in a sequence, lists of
// names.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"

namespace plenocal {

/// The first five names, and ", ..." where there are more.
std::string FirstNames(const std::vector<std::string>& names);

/// Calls `visit` with each observation of a camera, rejected ones too, that has a residual (px).
void ForEachResidual(
    const Bundle& bundle,
    size_t camera,
    const std::function<void(const BundleObservation& observation, const double* residual)>& visit);

/// Division of a sequence into two parts.
struct SequenceSplit {
  Eigen::Index first = 0;           ///< elements of the first part; 0: no division
  double between = 0, within = 0;   ///< weighted sums of squares
  Eigen::RowVectorXd step;          ///< mean of the second part less that of the first
  Eigen::Index all = 0, least = 0;  ///< elements, and those that each part has at least

  /// Probability by chance of so large a step in noise, among all divisions: F-test with one degree
  /// of freedom for the step. `variance`: least variance of the noise.
  [[nodiscard]] double Probability(double variance = 0) const;
};

/// The division with the largest step. `values`: a row an element; `weights`: inverse variances, up
/// to a factor; `accept`: which divisions count, by their first part's elements and their step.
SequenceSplit LargestSplit(
    const Eigen::MatrixXd& values,
    const Eigen::VectorXd& weights,
    Eigen::Index least,
    const std::function<bool(Eigen::Index, const Eigen::RowVectorXd&)>& accept = {});

}  // namespace plenocal
