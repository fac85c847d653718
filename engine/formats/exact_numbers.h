// SPDX-License-Identifier: Apache-2.0
//
// Numbers that survive the way to a file and back to the last digit.
#pragma once

#include <functional>
#include <span>
#include <string>

namespace plenocal {

/// The shortest text that reads back as `value`, always with a point or an exponent: readers that
/// require a real number refuse "500".
std::string RealText(double value);
/// The texts of several numbers, ", " between.
std::string RealList(std::span<const double> values);

/// The number that `forward` maps to `value` exactly, looked for about `guess`: undoing several
/// operations by their inverses loses the last digit (one alone is undone exactly by its inverse
/// where any number undoes it). `guess` when there is none.
double Inverted(double value, double guess, const std::function<double(double)>& forward);

}  // namespace plenocal
