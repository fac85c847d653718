// SPDX-License-Identifier: Apache-2.0
//
// Target type of circle grids.
#pragma once

#include <array>
#include <vector>

#include "targets/plane_grid.h"
#include "targets/target_type.h"

namespace plenocal {

/// Circle grid; the markers are the circles' centres, number row * columns + column. In an
/// asymmetric grid every second row is moved by `spacing` and circles of a row are 2 * spacing
/// apart.
struct CirclesLayout : internal::PlaneBoard {
  int columns = 0, rows = 0;
  double spacing = 0;  ///< m
  bool asymmetric = false;

  static Target Read(const YamlNode& node);
  static constexpr std::array kKeys{
      TargetKey{"columns", "", "circles in a row, 2 to 1000", ""},
      TargetKey{"rows", "", "rows of circles, 2 to 1000", ""},
      TargetKey{"spacing",
                "m",
                "distance between rows; between circles of a row this distance (symmetric) or "
                "twice this distance (asymmetric)",
                ""},
      TargetKey{"pattern", "", "symmetric or asymmetric", ""}};
  static constexpr std::array kTypes{
      TargetType{"circles",
                 kKeys,
                 "columns: 4\nrows: 7\nspacing: 0.02\npattern: asymmetric\n",
                 Read,
                 "spacing:pattern=symmetric"}};

  [[nodiscard]] TargetDoubts Doubts(const YamlNode& nominal) const;
  [[nodiscard]] std::vector<TargetPart> Draw(const MarkerPositions& markers, Pieces pieces) const;

  /// m, from a circle to the nearest other one.
  [[nodiscard]] double NearestDistance() const;
  /// m, of the circles as drawn: half of the way to the nearest circle is black, half white.
  [[nodiscard]] double DrawnRadius() const;
};

namespace internal {
/// Nominal positions.
MarkerPositions CirclePositions(const CirclesLayout& circles);
}  // namespace internal

}  // namespace plenocal
