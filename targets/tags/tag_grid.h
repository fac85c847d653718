// SPDX-License-Identifier: Apache-2.0
//
// Targets that are a regular grid of tags.
#pragma once

#include <Eigen/Core>
#include <array>

#include "targets/code_books.h"
#include "targets/target.h"

namespace plenocal::internal {

/// A regular grid of tags as Kalibr's: ids row by row from the lower left, x right, y up, the
/// origin in the lower left corner of the first tag.
struct TagGrid {
  int columns = 0, rows = 0;
  double size = 0;     ///< m, side of a tag's black border
  double spacing = 0;  ///< gap between tags / size
  int first_id = 0;
};

/// The tag's corners in a column and row of the grid, in the order of its markers.
std::array<Eigen::Vector3d, 4> TagCorners(const TagGrid& grid, int column, int row);

/// Refuses an id that the family does not have; nothing would ever detect that tag.
void CheckTagId(int id, const CodeBook& family, const YamlNode& node);

/// Target of a regular tag grid; `grid_node` is where a grid with too many tags is reported.
Target TagGridTarget(const TagGrid& grid,
                     const CodeBook& family,
                     int border_bits,
                     const YamlNode& grid_node);

}  // namespace plenocal::internal
