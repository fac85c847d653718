// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/exact_numbers.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>

namespace plenocal {
std::string RealText(double value) {
  std::string text = fmt::format("{}", value == 0 ? 0.0 : value);
  if (text.find_first_of(".e") == std::string::npos) text += ".0";
  return text;
}

std::string RealList(std::span<const double> values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : ", ") + RealText(value);
  return text;
}

double Inverted(double value, double guess, const std::function<double(double)>& forward) {
  double below = guess, above = guess;
  constexpr int kSteps = 8;  // a few operations lose no more
  for (int i = 0; i < kSteps; ++i) {
    if (forward(below) == value) return below;
    if (forward(above) == value) return above;
    below = std::nextafter(below, -std::numeric_limits<double>::infinity());
    above = std::nextafter(above, std::numeric_limits<double>::infinity());
  }
  return guess;
}

}  // namespace plenocal
