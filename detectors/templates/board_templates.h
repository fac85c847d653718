// SPDX-License-Identifier: Apache-2.0
//
// Templates of markers whose position in the pattern follows from their neighbours in the image.
#pragma once

#include <functional>
#include <vector>

#include "calib/camera/observation.h"
#include "detectors/templates/cell_template.h"
#include "detectors/templates/marker_template.h"
#include "targets/target.h"

namespace plenocal::internal {

/// Draws the pattern around the corner in a column and row: squares, as many to each side of it.
using DrawCorner = std::function<CellTemplate(int column, int row)>;

/// Corners of squares, number row * columns + column. The pattern that `draw` returns is `squares`
/// x `squares` squares with the corner in the middle, coordinates in squares.
std::vector<MarkerTemplate> CornerTemplates(int columns,
                                            const std::vector<Observation>& found,
                                            int squares,
                                            const DrawCorner& draw);

/// Discs in a plane.
struct DiscGrid {
  double nearest = 0;  ///< m, from a disc's centre to the nearest other one
  double radius = 0;   ///< m, as drawn
};

/// Discs whose centres are the markers of `target`.
std::vector<MarkerTemplate> DiscTemplates(const DiscGrid& discs,
                                          const Target& target,
                                          const std::vector<Observation>& found);

}  // namespace plenocal::internal
