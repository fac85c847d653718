// SPDX-License-Identifier: Apache-2.0
#include "targets/tags/tag_grid.h"

#include <fmt/format.h>

#include <numeric>
#include <string>

namespace plenocal::internal {
namespace {

std::vector<int> TagIds(const TagGrid& grid) {
  std::vector<int> ids(static_cast<size_t>(grid.columns) * static_cast<size_t>(grid.rows));
  std::iota(ids.begin(), ids.end(), grid.first_id);
  return ids;
}

MarkerPositions CornerPositions(const TagGrid& grid) {
  MarkerPositions markers;
  int number = 4 * grid.first_id;
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      for (const Eigen::Vector3d& corner : TagCorners(grid, column, row))
        markers[number++] = corner;
    }
  }
  return markers;
}

}  // namespace

std::array<Eigen::Vector3d, 4> TagCorners(const TagGrid& grid, int column, int row) {
  const double pitch = (1 + grid.spacing) * grid.size, s = grid.size;
  const Eigen::Vector3d lower_left(column * pitch, row * pitch, 0);
  return {lower_left,
          lower_left + Eigen::Vector3d(s, 0, 0),
          lower_left + Eigen::Vector3d(s, s, 0),
          lower_left + Eigen::Vector3d(0, s, 0)};
}

void CheckTagId(int id, const CodeBook& family, const YamlNode& node) {
  if (id >= 0 && id < family.size) return;
  node.Fail(fmt::format("expected an id of {}, 0 to {}, got {}; correct the id or the family",
                        family.name,
                        family.size - 1,
                        id));
}

Target TagGridTarget(const TagGrid& grid,
                     const CodeBook& family,
                     int border_bits,
                     const YamlNode& grid_node) {
  CheckTagId(grid.first_id, family, grid_node);
  CheckTagId(grid.first_id + grid.columns * grid.rows - 1, family, grid_node);
  Target target;
  target.layout = TagLayout{.family = std::string(family.name),
                            .border_bits = border_bits,
                            // Kalibr's way of printing: two bits of border and squares between.
                            .black_corner_squares = border_bits == 2,
                            .ids = TagIds(grid)};
  target.markers = CornerPositions(grid);
  return target;
}

}  // namespace plenocal::internal
