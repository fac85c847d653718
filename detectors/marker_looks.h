// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <variant>
#include <vector>

#include "calib/observation.h"
#include "detectors/cell_drawing.h"
#include "detectors/disc_drawing.h"
#include "targets/target.h"

namespace plenocal::internal {

/// What a target looks like around one marker that was found in an image.
struct MarkerLook {
  int marker = 0;
  Eigen::Vector2d place{0, 0};  ///< of the marker in the image, px
  /// Homography from the image to the drawing's cells, or about a disc to its nominal radius.
  Eigen::Matrix3d cells_by_image;
  std::variant<CellDrawing, DiscDrawing> drawing;  ///< -1 and 1
  /// Cells around a tag, of which the outermost are of some other brightness; 0: all are known.
  int around = 0;
  int part = 0;  ///< markers of one flat part of the target share it
};

/// The looks of the markers found in one image: the corners of whole tags, the corners of
/// chessboards and ChArUco boards and the circles with enough neighbours to say how the pattern
/// lies there. Circles are drawn as `DrawTarget` does; how large they are is not part of a target.
std::vector<MarkerLook> LooksOf(const Target& target, const std::vector<Observation>& found);

}  // namespace plenocal::internal
