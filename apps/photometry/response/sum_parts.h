// SPDX-License-Identifier: Apache-2.0
//
// Sums over a long loop in parts: equal for any number of threads.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "calib/base/parallel.h"

namespace plenocal {

inline constexpr std::size_t kSumParts = 16;

/// The sum of what body(part, &sum) adds to `zero` for each of the parts. `Sum` has an operator +=.
template <typename Sum, typename Body>
Sum SumParts(const Sum& zero, int threads, const Body& body) {
  std::vector<Sum> sums(kSumParts, zero);
  ParallelFor(kSumParts, threads, [&](std::size_t part) { body(part, &sums[part]); });
  for (std::size_t part = 1; part < kSumParts; ++part) sums[0] += sums[part];
  return std::move(sums[0]);
}

}  // namespace plenocal
