// SPDX-License-Identifier: Apache-2.0
//
// Images of a raw plenoptic image that need no depth: one per direction of the light in the micro
// images, and sums of these along one virtual depth. They serve unfocused cameras too, whose micro
// images show the main lens' stop and not the scene.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "detectors/plenoptic/depth/lens_patches.h"
#include "detectors/plenoptic/depth/micro_lens_index.h"

namespace plenocal::internal {

/// Pixel (i, j) of an image at raw px step * (i, j).
struct ViewGrid {
  double step = 1;
  cv::Size size;
};

/// The grid over a raw image with a pixel every `step` px.
ViewGrid MakeViewGrid(ImageSize image_size, double step);

/// The sub-aperture image of `offset`, px from the micro-image centres: at each micro-image centre
/// the value there, between centres interpolated over the lattice. CV_32F, NaN where no micro image
/// near shows that offset.
cv::Mat SubApertureImage(const LensPatches& patches,
                         const MicroLensIndex& index,
                         const Eigen::Vector2d& offset,
                         const ViewGrid& grid);

/// The image that is sharp at one virtual depth v: the pixel at x in the micro image around c is
/// added to the place c + v (x - c), weighted by its attenuation squared (docs/plenoptic.md,
/// equation 1). At v = 0 it is sharp for points that the main lens images on the micro lenses.
/// CV_32F, NaN where nothing falls.
cv::Mat RefocusedImage(const LensPatches& patches,
                       const MicroLensArray& array,
                       double virtual_depth,
                       const ViewGrid& grid);

}  // namespace plenocal::internal
