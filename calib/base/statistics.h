// SPDX-License-Identifier: Apache-2.0
//
// Medians and quantiles, and tails of distributions for significance tests.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace plenocal {

/// False-alarm rate of the tests whether a rig is rigid, priors hold and points share errors.
inline constexpr double kFalseAlarm = 1e-3;

/// Median; of an even number of values the upper one of the middle two. `if_empty`: for no values.
template <typename T>
T Median(std::vector<T> values, T if_empty = T(0)) {
  if (values.empty()) return if_empty;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// The value below which `part` of the values are; 0 of none.
double Quantile(std::vector<double> values, double part);

/// P(chi-square with k degrees of freedom > x). Degrees of freedom are finite here and below; a
/// number of them that is not positive gives NaN.
double ChiSquareTail(double k, double x);

/// x with ChiSquareTail(k, x) = p.
double ChiSquareQuantile(double k, double p);

/// P(F > x) with m and n degrees of freedom.
double FTail(double x, double m, double n);

/// P(t > x) of Student's t with n degrees of freedom.
double StudentTail(double x, double n);

/// P(X > x) of a sum of squares with weights whose sum and sum of squares are given: X is taken for
/// a multiple of chi-square of fitting degrees of freedom (Satterthwaite 1946).
double TailOfWeightedSquares(double x, double sum, double sum_of_squares);

}  // namespace plenocal
