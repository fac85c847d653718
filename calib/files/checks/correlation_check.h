// SPDX-License-Identifier: Apache-2.0
//
// The check that numbers of a file can be correlations.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <string>

namespace plenocal {

/// Half a unit of the last of the twelve digits with which files hold correlations.
inline constexpr double kCorrelationRounding = 5e-13;

/// The reason for which a matrix, whose numbers are off by at most `rounding`, cannot be one of
/// correlations, with two of the `names` of the unknowns; nothing when it can. Rows of zeros are
/// those of known numbers.
std::optional<std::string> CorrelationDefect(const Eigen::MatrixXd& matrix,
                                             std::span<const std::string> names,
                                             double rounding);

}  // namespace plenocal
