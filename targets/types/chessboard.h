// SPDX-License-Identifier: Apache-2.0
//
// Target type of chessboards.
#pragma once

#include <array>
#include <vector>

#include "targets/plane_grid.h"
#include "targets/target_type.h"

namespace plenocal {

/// Chessboard; the markers are its inner corners, number row * columns + column, x along the
/// columns, y down.
struct ChessboardLayout : internal::PlaneBoard {
  int columns = 0, rows = 0;  ///< inner corners
  double square = 0;          ///< m, side of a square

  static Target Read(const YamlNode& node);
  static constexpr std::array kKeys{
      TargetKey{"columns", "", "inner corners in a row, 2 to 1000", ""},
      TargetKey{"rows", "", "inner corners in a column, 2 to 1000", ""},
      TargetKey{"square", "m", "side of a square", ""}};
  static constexpr std::array kTypes{
      TargetType{"chessboard", kKeys, "columns: 6\nrows: 5\nsquare: 0.03\n", Read, "square"}};

  [[nodiscard]] TargetDoubts Doubts(const YamlNode& nominal) const;
  [[nodiscard]] std::vector<TargetPart> Draw(const MarkerPositions& markers, Pieces pieces) const;
};

}  // namespace plenocal
