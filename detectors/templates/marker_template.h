// SPDX-License-Identifier: Apache-2.0
//
// Templates of a target's markers where an image shows them.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <variant>
#include <vector>

#include "calib/camera/observation.h"
#include "detectors/templates/cell_template.h"
#include "detectors/templates/disc_template.h"
#include "targets/target.h"

namespace plenocal::internal {

/// The pattern of a target around one marker that was found in an image.
struct MarkerTemplate {
  int marker = 0;
  Eigen::Vector2d position{0, 0};  ///< of the marker in the image, px
  /// Homography from the image to the pattern's cells, or about a disc to its nominal radius.
  Eigen::Matrix3d cells_by_image;
  std::variant<CellTemplate, DiscTemplate> pattern;  ///< -1 black, 1 white
  /// Cells around a tag; the brightness of the outermost is unknown. 0: all cells are known.
  int margin = 0;
  int part = 0;  ///< markers of one flat part of the target share it
};

/// Templates for the markers found in one gray image: the corners of whole tags, and the corners of
/// chessboards and ChArUco boards and the circles with enough neighbours for a homography. Throws
/// `Error` for a type without a detector. Defined in detectors/types/marker_detectors.cc.in, which
/// collects the functions of all types.
std::vector<MarkerTemplate> MakeMarkerTemplates(const Target& target,
                                                const std::vector<Observation>& found,
                                                const cv::Mat& gray);

}  // namespace plenocal::internal
