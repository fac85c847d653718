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
  const double pitch = (1 + grid.spacing) * grid.size;
  MarkerPositions markers;
  int id = grid.first_id;
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column, ++id) {
      const Eigen::Vector3d lower_left(column * pitch, row * pitch, 0);
      markers[4 * id] = lower_left;
      markers[4 * id + 1] = lower_left + Eigen::Vector3d(grid.size, 0, 0);
      markers[4 * id + 2] = lower_left + Eigen::Vector3d(grid.size, grid.size, 0);
      markers[4 * id + 3] = lower_left + Eigen::Vector3d(0, grid.size, 0);
    }
  }
  return markers;
}

}  // namespace

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
