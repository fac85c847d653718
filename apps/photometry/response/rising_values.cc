// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/response/rising_values.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace plenocal {
namespace {

// Slope at the middle one of three points, zero unless both sides rise: harmonic mean.
double MonotoneSlope(double left, double right) {
  return left > 0 && right > 0 ? 2 * left * right / (left + right) : 0;
}

}  // namespace

void FillGaps(ResponseCurve::Table& values) {
  std::vector<size_t> known;
  for (size_t k = 0; k < values.size(); ++k) {
    if (!std::isnan(values[k])) known.push_back(k);
  }
  const auto secant = [&](size_t i) {
    return (values[known[i + 1]] - values[known[i]]) / static_cast<double>(known[i + 1] - known[i]);
  };
  const auto slope = [&](size_t i) {
    if (i == 0) return secant(0);
    if (i + 1 == known.size()) return secant(i - 1);
    return MonotoneSlope(secant(i - 1), secant(i));
  };
  for (size_t i = 0; i + 1 < known.size(); ++i) {
    const double a = values[known[i]], b = values[known[i + 1]];
    const auto width = static_cast<double>(known[i + 1] - known[i]);
    const double at_a = slope(i) * width, at_b = slope(i + 1) * width;
    for (size_t k = known[i] + 1; k < known[i + 1]; ++k) {
      const double t = static_cast<double>(k - known[i]) / width;  // Hermite's cubic
      values[k] = (1 + 2 * t) * (1 - t) * (1 - t) * a + t * (1 - t) * (1 - t) * at_a +
                  t * t * (3 - 2 * t) * b - t * t * (1 - t) * at_b;
    }
  }
  // The outermost values are the least certain, so the line's slope is that over some of them.
  constexpr size_t kSpan = 3;
  const size_t first = known.front(), last = known.back();
  const size_t after = std::min(first + kSpan, last), before = last - std::min(kSpan, last - first);
  const double rise_first = (values[after] - values[first]) / static_cast<double>(after - first);
  const double rise_last = (values[last] - values[before]) / static_cast<double>(last - before);
  for (size_t k = 0; k < first; ++k) {
    values[k] = values[first] - rise_first * static_cast<double>(first - k);
  }
  for (size_t k = last + 1; k < values.size(); ++k) {
    values[k] = values[last] + rise_last * static_cast<double>(k - last);
  }
}

void MakeRising(ResponseCurve::Table& values,
                const std::array<double, ResponseCurve::kValues>& weights) {
  struct Pool {
    double value, weight;
    size_t size;
  };
  std::vector<Pool> pools;
  for (size_t k = 0; k < values.size(); ++k) {
    pools.push_back({values[k], std::max(weights[k], 1e-9), 1});
    while (pools.size() > 1 && pools[pools.size() - 2].value >= pools.back().value) {
      const Pool last = pools.back();
      pools.pop_back();
      Pool& into = pools.back();
      const double share = last.weight / (into.weight + last.weight);
      into.value += share * (last.value - into.value);
      into.weight += last.weight;
      into.size += last.size;
    }
  }
  const double least_step = 1e-6 * std::abs(pools.back().value - pools.front().value);
  size_t k = 0;
  for (const Pool& pool : pools) {
    for (size_t i = 0; i < pool.size; ++i, ++k) {
      values[k] = k == 0 ? pool.value : std::max(pool.value, values[k - 1] + least_step);
    }
  }
}

}  // namespace plenocal
