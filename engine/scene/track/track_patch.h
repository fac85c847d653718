// SPDX-License-Identifier: Apache-2.0
//
// The surroundings of a point in one image fitted to another image.
#pragma once

#include <opencv2/core.hpp>
#include <optional>

namespace plenocal {

/// Half the side of a patch, px.
inline constexpr int kPatchRadius = 10;

/// A patch in an image: the pixel d about the point in the key image is at
/// point + A d / (1 + perspective . d), as on a plane.
struct PatchPlace {
  cv::Point2f point;
  cv::Matx22f A = cv::Matx22f::eye();
  cv::Vec2f perspective = {0, 0};  ///< 1/px
  double sigma = 0;  ///< of a coordinate of `point`, px, from the residuals of the fit
};

/// Fits homography, gain and offset of the patch about `in_key` to the image by the inverse
/// compositional algorithm (Baker and Matthews 2004, with the gain as an unknown). An affine fit
/// takes the perspective of a slanted surface for a translation, the same for all points of a wall.
/// Images: CV_8U. `start` is right within two pixels. Nothing when the patch leaves either image,
/// moves farther than that or correlates by less than 0.8.
std::optional<PatchPlace> FitPatch(const cv::Mat& key,
                                   const cv::Point2f& in_key,
                                   const cv::Mat& image,
                                   const PatchPlace& start);

}  // namespace plenocal
