// SPDX-License-Identifier: Apache-2.0
//
// Functions that tests for causes share: residuals of a camera, a step in a sequence, lists of
// names.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"

namespace plenocal {

/// The first five names, followed by ", ..." if there are more.
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
  Eigen::Index all = 0, least = 0;  ///< number of elements, least number in a part

  /// Probability that noise gives so large a step in any of the divisions: F-test with one degree
  /// of freedom for the step. `variance`: lower limit of the noise variance.
  [[nodiscard]] double Probability(double variance = 0) const;
};

/// The division with the largest step. `values`: one row per element; `weights`: inverse variances
/// up to a factor; `accept`: whether a division counts, by the number of elements in its first part
/// and its step.
SequenceSplit LargestSplit(
    const Eigen::MatrixXd& values,
    const Eigen::VectorXd& weights,
    Eigen::Index least,
    const std::function<bool(Eigen::Index, const Eigen::RowVectorXd&)>& accept = {});

}  // namespace plenocal
