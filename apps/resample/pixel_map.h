// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

#include "calib/calibration_file.h"

namespace plenocal {

/// Where the pixels of a new view lie in a camera's image: remap tables as cv::remap takes them.
struct PixelMap {
  /// Both coordinates of a pixel whose direction the camera does not image. (NaN would be undefined
  /// in cv::remap, and no camera has its image there and only there.)
  static constexpr float kNowhere = -1;

  ImageSize size{};         ///< of the view
  ImageSize source_size{};  ///< of the camera's image
  std::vector<float> x, y;  ///< row by row, px; may lie outside of the camera's image

  /// Whether pixel i of the view lies on a pixel of the camera's image.
  [[nodiscard]] bool HasSource(size_t i) const;
};

/// Where in an image a direction of a view's frame is seen, px; nothing where it is not.
using ImagePlace = std::function<std::optional<Eigen::Vector2d>(const Eigen::Vector3d& direction)>;

/// The map by which `view`, a central camera, shows an image. `place` is called from several
/// threads; `threads` as in ParallelFor.
PixelMap MapPixels(const CalibratedCamera& view,
                   ImageSize source_size,
                   const ImagePlace& place,
                   int threads);

/// The same of the image of `camera`, central and in the place of the view; R_camera_view turns
/// directions of the view's frame into the camera's.
PixelMap MapPixels(const CalibratedCamera& view,
                   const CalibratedCamera& camera,
                   const Eigen::Matrix3d& R_camera_view,
                   int threads);

}  // namespace plenocal
