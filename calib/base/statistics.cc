// SPDX-License-Identifier: Apache-2.0
#include "calib/base/statistics.h"

#include <cmath>
#include <numbers>

namespace plenocal {

double ChiSquareTail(int k, double x) {
  const double h = x / 2;
  double q = k % 2 == 1 ? std::erfc(std::sqrt(h)) : std::exp(-h);
  double a = k % 2 == 1 ? 0.5 : 1.0;
  for (; 2 * a < k; a += 1) q += std::exp(a * std::log(h) - h - std::lgamma(a + 1));
  return q;
}

double ChiSquareQuantile(int k, double p) {
  double low = 0, high = 1;
  while (ChiSquareTail(k, high) > p) high *= 2;
  for (int i = 0; i < 100; ++i) {
    const double middle = (low + high) / 2;
    (ChiSquareTail(k, middle) > p ? low : high) = middle;
  }
  return high;
}

double FTail(double x, double m, double n) {
  const double root = std::cbrt(x), a = 2 / (9 * m), b = 2 / (9 * n);
  const double z = ((1 - b) * root - (1 - a)) / std::sqrt(b * root * root + a);
  return std::erfc(z / std::numbers::sqrt2) / 2;
}

double StudentTail(double x, double n) {
  const double one_sided = FTail(x * x, 1, n) / 2;
  return x > 0 ? one_sided : 1 - one_sided;
}

}  // namespace plenocal
