// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "targets/target.h"

namespace plenocal::internal {

/// What a ChArUco board's white squares hold.
struct CharucoLooks {
  int width = 0;  ///< of a marker with its black border, cells
  struct Marker {
    Eigen::Vector2i square;   ///< column, row
    std::vector<bool> white;  ///< width x width, row by row
  };
  std::vector<Marker> markers;  ///< one for each white square
};

/// Without a statement by the file the board is drawn as OpenCV 4.7 and later do.
CharucoLooks FindCharucoLooks(const CharucoLayout& board);

}  // namespace plenocal::internal
