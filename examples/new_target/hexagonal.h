// SPDX-License-Identifier: Apache-2.0
//
// Example of a target type (docs/architecture.md): in targets/types/.
#pragma once

#include <array>
#include <vector>

#include "targets/plane_grid.h"
#include "targets/target_type.h"

namespace plenocal {

/// Circles in a hexagonal grid, each with six neighbours at the same distance: every second row is
/// moved by half of the spacing. The markers are the circles' centres, number
/// row * columns + column.
struct HexagonalLayout : internal::PlaneBoard {
  int columns = 0, rows = 0;
  double spacing = 0;  ///< m, between neighbouring circles

  static Target Read(const YamlNode& node);
  static constexpr std::array kKeys{
      TargetKey{"columns", "", "circles in a row, 2 to 1000", ""},
      TargetKey{"rows", "", "rows of circles, 2 to 1000", ""},
      TargetKey{"spacing", "m", "distance between neighbouring circles", ""}};
  static constexpr std::array kTypes{
      TargetType{"hexagonal", kKeys, "columns: 9\nrows: 8\nspacing: 0.03\n", Read}};

  [[nodiscard]] TargetDoubts Doubts(const YamlNode& nominal) const;
  [[nodiscard]] std::vector<TargetPart> Draw(const MarkerPositions& markers, Pieces pieces) const;
};

}  // namespace plenocal
