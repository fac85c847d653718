// SPDX-License-Identifier: Apache-2.0
//
// Colour filters of raw mosaics.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string_view>

namespace plenocal {

/// Colours of the top-left 2 x 2 pixels of a raw mosaic, row by row. Where images may be mosaics or
/// not, a `std::optional<BayerOrder>` is empty for those that are not.
enum class BayerOrder { kRggb, kBggr, kGrbg, kGbrg };

/// Names in files and on the command line, in the order of the enumerators.
inline constexpr std::array<std::string_view, 4> kBayerOrders{"RGGB", "BGGR", "GRBG", "GBRG"};

constexpr std::string_view BayerName(BayerOrder order) {
  return kBayerOrders[static_cast<std::size_t>(order)];
}

/// Nothing for a name that is none of `kBayerOrders`.
constexpr std::optional<BayerOrder> ParseBayerOrder(std::string_view name) {
  for (std::size_t i = 0; i < kBayerOrders.size(); ++i) {
    if (kBayerOrders[i] == name) return static_cast<BayerOrder>(i);
  }
  return std::nullopt;
}

/// 'R', 'G' or 'B': the filter of pixel (x, y).
constexpr char BayerColour(BayerOrder order, int x, int y) {
  return BayerName(order)[static_cast<std::size_t>(2 * (y % 2) + x % 2)];
}

}  // namespace plenocal
