// SPDX-License-Identifier: Apache-2.0
//
// Pictures of vectors over an image, as a map of colours with arrows.
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

  /// Puts a vector into the cell that has the pixel (x, y).
  void Put(double x, double y, const std::array<double, 2>& vector) {
    const auto column = static_cast<size_t>((x + 0.5) / image_size[0] * columns);
    const auto row = static_cast<size_t>((y + 0.5) / image_size[1] * rows);
    vectors.resize(static_cast<size_t>(columns) * static_cast<size_t>(rows));
    vectors[row * static_cast<size_t>(columns) + column] = vector;
  }
};

/// The content of a PNG file: maps below each other, length as colour with a scale from 0 to
/// `largest` px, direction and length as arrows of one scale, which is printed.
std::string DrawFieldMaps(const std::vector<FieldMap>& maps, double largest);

}  // namespace plenocal
