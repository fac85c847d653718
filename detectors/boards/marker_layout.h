// SPDX-License-Identifier: Apache-2.0
//
// The arrangement of numbered markers on a board, from the images that show them.
#pragma once

#include <optional>
#include <vector>

#include "targets/tags/quad.h"

namespace plenocal::internal {

/// A marker with a number, as seen in one image.
struct NumberedSquare {
  int id = 0;
  Quad corners;  ///< px: upper left, upper right, lower right, lower left of the upright marker
};

/// How numbered markers are arranged on a board.
struct MarkerLayout {
  enum class Kind {
    kRowsUp,    ///< a grid, ids row by row from the lower left, as Kalibr's AprilGrid
    kRowsDown,  ///< a grid, ids row by row from the upper left
    kCharuco,   ///< in the white squares of a chessboard, ids row by row from the upper left
  };
  Kind kind = Kind::kRowsUp;
  int columns = 0, rows = 0;  ///< of markers; of a chessboard squares
  int first_id = 0;
  double pitch = 0;  ///< distance of columns / side of a marker
};

/// The layout that explains where the markers of several images are to each other; nothing when
/// none does. Markers at the board's rim that no image shows are not counted.
std::optional<MarkerLayout> FindMarkerLayout(
    const std::vector<std::vector<NumberedSquare>>& images);

}  // namespace plenocal::internal
