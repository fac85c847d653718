// SPDX-License-Identifier: Apache-2.0
//
// Depth in the virtual image: the estimates of all micro images at each of its points, fused.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "calib/camera/micro_lens_array.h"
#include "detectors/plenoptic/depth/pixel_depth.h"

namespace plenocal {

/// Inverse virtual depth z = 1 / v over the virtual image, that is over the points q that a micro
/// image around c shows at x = c + z (q - c) (docs/plenoptic.md, "Virtual depth"). Pixel (i, j) of
/// the maps is at q = scale * (i, j), raw px.
struct VirtualDepth {
  double scale = 1;
  cv::Mat inverse;  ///< CV_32F, filled everywhere when anything is known, else NaN
  cv::Mat sigma;    ///< CV_32F, standard deviation of `inverse`
  cv::Mat known;    ///< CV_8U, 255 where measured or within one micro image of a measurement
};

namespace internal {

/// The known inverse depths, row by row.
std::vector<float> KnownInverse(const VirtualDepth& depth);

/// Projects the estimates of all micro images into the virtual image of `scale` raw px a pixel,
/// fuses those that agree and fills between them. `radius_px`: of a micro image.
VirtualDepth FuseDepth(std::vector<LensDepth> depths,
                       const MicroLensArray& array,
                       float radius_px,
                       double scale,
                       int threads);

}  // namespace internal
}  // namespace plenocal
