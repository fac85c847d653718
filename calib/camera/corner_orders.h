// SPDX-License-Identifier: Apache-2.0
//
// Orders in which a tag's corners may be numbered.
#pragma once

#include <array>
#include <cstddef>
#include <string>

namespace plenocal {

/// The orders in which a tag's corners can be written by mistake: what is written at place k is
/// corner `kCornerOrders[i][k]` of lower left, lower right, upper right, upper left.
inline constexpr std::array<std::array<size_t, 4>, 7> kCornerOrders{{{3, 2, 1, 0},
                                                                     {1, 2, 3, 0},
                                                                     {2, 3, 0, 1},
                                                                     {3, 0, 1, 2},
                                                                     {0, 3, 2, 1},
                                                                     {1, 0, 3, 2},
                                                                     {2, 1, 0, 3}}};

/// "upper left, upper right, lower right, lower left".
inline std::string CornerOrderText(size_t order) {
  constexpr std::array kNames{"lower left", "lower right", "upper right", "upper left"};
  std::string text;
  for (const size_t corner : kCornerOrders[order]) {
    text += std::string(text.empty() ? "" : ", ") + kNames[corner];
  }
  return text;
}

}  // namespace plenocal
