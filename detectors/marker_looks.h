// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "calib/observation.h"
#include "detectors/cell_drawing.h"
#include "targets/target.h"

namespace plenocal::internal {

/// What a target looks like around one marker that was found in an image.
struct MarkerLook {
  int marker = 0;
  Eigen::Vector2d place{0, 0};     ///< of the marker in the image, px
  Eigen::Matrix3d cells_by_image;  ///< homography from the image to the drawing's cells
  CellDrawing drawing;             ///< -1 and 1
  bool beyond_unknown = false;     ///< the outermost cells are of some other brightness
  int part = 0;                    ///< markers of one flat part of the target share it
};

/// The looks of the markers found in one image: the corners of whole tags, the corners of
/// chessboards and ChArUco boards with enough neighbours to say how the pattern lies there. Circle
/// grids have none.
std::vector<MarkerLook> LooksOf(const Target& target, const std::vector<Observation>& found);

}  // namespace plenocal::internal
