// SPDX-License-Identifier: Apache-2.0
//
// The image circle of a lens, from what stays black in all images.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "calib/camera/image_circle.h"
#include "calib/camera/observation.h"
#include "calib/traits/image_grid.h"

namespace plenocal::internal {

/// Mean grey levels of the cells of an image, row by row; 24 cells along its longer side. `gray`:
/// 8 bits.
std::vector<std::uint8_t> CellLevels(const cv::Mat& gray);

/// Collects the cell levels of a camera's images, which are all of one size.
class ImageCircleFit {
 public:
  explicit ImageCircleFit(ImageSize image_size);

  void Add(const std::vector<std::uint8_t>& levels);

  /// The ellipse whose outside is black in all images and whose inside is not in all. Nothing where
  /// no such ellipse lies within the image, or the edge of the lit part is no ellipse: that is a
  /// dark scene.
  [[nodiscard]] std::optional<ImageCircle> Fit() const;

 private:
  [[nodiscard]] std::vector<Eigen::Vector2d> Rim(double limit) const;

  ImageGrid grid_;
  std::vector<double> lightest_;  // per cell
  double black_ = 255;
};

}  // namespace plenocal::internal
