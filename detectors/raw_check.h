// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>
#include <string>

#include "calib/micro_lens_array.h"

namespace plenocal::internal {

/// Whether a raw image (CV_32F) has its micro images where the grid says. Inside each cell of the
/// lattice the raw image must follow the attenuation: raw - mean = s * (attenuation - mean) * gain.
/// The scene is as often brighter in the middle of a cell as darker, so over many cells s is 1 for
/// the right grid and 0 for any other, with a standard error that the scatter between cells gives.
/// Less than 1/2 is the wrong grid, over the whole image or in a ninth of it.
///
/// Returns why the image does not belong to the grid, in words for the user, or nothing.
std::string WhyNotOfThisGrid(const cv::Mat& raw,
                             const cv::Mat& attenuation,
                             const MicroLensArray& array);

}  // namespace plenocal::internal
