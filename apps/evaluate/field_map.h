// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace plenocal {

/// Vectors on a regular grid over an image.
struct FieldMap {
  std::string title;
  std::array<int, 2> image_size{};  ///< px
  int columns = 0, rows = 0;
  /// Row by row, at the middles of the cells, px; nothing where there is none.
  std::vector<std::optional<std::array<double, 2>>> vectors;
};

/// The content of a PNG file: maps below each other, length as colour with a scale from 0 to
/// `largest` px, direction and length as arrows of one scale, which is said.
std::string DrawFieldMaps(const std::vector<FieldMap>& maps, double largest);

}  // namespace plenocal
