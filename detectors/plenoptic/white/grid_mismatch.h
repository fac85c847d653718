// SPDX-License-Identifier: Apache-2.0
//
// Check of a raw image against the grid of micro lenses.
#pragma once

#include <opencv2/core/mat.hpp>
#include <string>

#include "calib/camera/micro_lens_array.h"

namespace plenocal::internal {

/// Checks that a raw image (CV_32F) has its micro images at the grid's positions. Inside each cell
/// of the lattice the raw image must follow the attenuation: raw - mean = s * (attenuation - mean)
/// * gain. The scene is as often brighter in the middle of a cell as darker, so over many cells s
/// is 1 for the right grid and 0 for any other, with a standard error by the scatter between cells.
/// The grid is wrong for s < 1/2 over the whole image or in a ninth of it.
///
/// Returns the reason why the image does not belong to the grid, for the user, or nothing.
std::string GridMismatch(const cv::Mat& raw,
                         const cv::Mat& attenuation,
                         const MicroLensArray& array);

}  // namespace plenocal::internal
