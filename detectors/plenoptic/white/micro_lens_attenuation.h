// SPDX-License-Identifier: Apache-2.0
//
// Attenuation of a plenoptic camera from its white images.
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>

#include "calib/camera/bayer.h"
#include "detectors/plenoptic/white/micro_lens_grid.h"

namespace plenocal {

/// Attenuation (as in detectors/images/attenuation.h) of a plenoptic camera, unsmoothed: the white
/// image over the highest value of the smooth envelope of its micro images. `grid`: found in
/// `white`, for a mosaic in its levelled planes.
cv::Mat MicroLensAttenuation(const cv::Mat& white,
                             const MicroLensGrid& grid,
                             std::optional<BayerOrder> bayer);

/// The four planes of a raw Bayer mosaic divided by their own large-scale means and brought to that
/// of the mosaic, so that the colours of the filters and of the light do not show. (Never
/// demosaiced: that would mix micro images.)
cv::Mat LevelBayerPlanes(const cv::Mat& mosaic);

}  // namespace plenocal
