// SPDX-License-Identifier: Apache-2.0
//
// Points of an unknown scene measured in the raw image of a plenoptic camera. As with markers, each
// micro image is measured by itself, so that its row for the bundle adjustment has the errors of
// its own pixels; the template is the point's surroundings in the totally focused image of the
// frame in which it was found.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "calib/camera/observation.h"
#include "detectors/plenoptic/depth/reconstruction.h"

namespace plenocal {

/// A scene point, as the totally focused images of two frames show it.
struct ScenePatch {
  int number = 0;
  const cv::Mat* reference = nullptr;  ///< focused image where it was found, CV_8U
  Eigen::Vector2d in_reference{0, 0};  ///< its position there, px of the focused image
  Eigen::Vector2d position{0, 0};      ///< in the present focused image, px of it
  /// Affine distortion of the patch: d px beside `in_reference` are by_reference d beside
  /// `position`.
  Eigen::Matrix2d by_reference = Eigen::Matrix2d::Identity();
};

/// Observations x, y, lens_x, lens_y of each point in the micro images that have it well inside,
/// by ascending number and with `detector_sigma` and `lens_type`. `patches`: of the raw image,
/// without corrections (`GreyPatches`).
///
/// In the micro image around c the patch is scaled by the inverse virtual depth z, and x = c +
/// z (q - c) (docs/plenoptic.md, equation 1). Translation, gain and offset are fitted to the
/// pixels; z starts from the depth map and follows from the positions of all micro images (equation
/// 2), with which they are measured once more. A point is left out where fewer than three micro
/// images agree, and where the depth under its patch varies by more than half a pixel of parallax.
std::vector<Observation> MeasurePatches(const std::vector<ScenePatch>& points,
                                        const Reconstruction& view,
                                        const internal::LensPatches& patches,
                                        const MicroLensArray& array,
                                        int threads);

}  // namespace plenocal
