// SPDX-License-Identifier: Apache-2.0
//
// Maps from the pixels of a new view to a camera's image.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// For each pixel of a new view its position in a camera's image: remap tables for cv::remap.
struct PixelMap {
  /// Both coordinates of a pixel whose direction the camera does not image. (NaN is undefined in
  /// cv::remap, and -1 lies outside of every image.)
  static constexpr float kNowhere = -1;

  ImageSize size{};         ///< of the view
  ImageSize source_size{};  ///< of the camera's image
  std::vector<float> x, y;  ///< row by row, px; may lie outside of the camera's image

  /// True when pixel i of the view has a position inside the camera's image.
  [[nodiscard]] bool HasSource(size_t i) const;
};

/// Position in an image of a direction in a view's frame, px; nothing where it is not imaged.
using ImagePlace = std::function<std::optional<Eigen::Vector2d>(const Eigen::Vector3d& direction)>;

/// The map from `view`, a central camera, to an image. `place` is called from several
/// threads; `threads` as in ParallelFor.
PixelMap MapPixels(const CalibratedCamera& view,
                   ImageSize source_size,
                   const ImagePlace& place,
                   int threads);

/// Throws `Error` of kind kInput for a camera that is not central.
void RequireCentral(const CalibratedCamera& camera);

/// The map to the image of `camera`, central (`RequireCentral`) and at the position of the view; R_camera_view rotates
/// directions of the view's frame into the camera's.
PixelMap MapPixels(const CalibratedCamera& view,
                   const CalibratedCamera& camera,
                   const Eigen::Matrix3d& R_camera_view,
                   int threads);

}  // namespace plenocal
