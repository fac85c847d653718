// SPDX-License-Identifier: Apache-2.0
//
// Check of a raw image against the grid of micro lenses.
#pragma once

#include <array>
#include <opencv2/core/mat.hpp>
#include <string>

#include "calib/camera/micro_lens_array.h"
#include "calib/traits/lattice_shift.h"

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

/// Measures the displacement of the micro images of a raw image that `GridMismatch` accepts, by
/// least squares: inside a cell it is V (1 + e . d + s . grad ln V) times a gain, V the
/// attenuation, d from the cell's middle, e the scene's gradient and s the displacement, which is
/// common to all cells but for pitch and rotation; repeated from the nearest whole pixels.
/// Standard errors are by the scatter of the cells. Not measured where V has no micro images.
/// `by_place`: factors that make the four pixels of the 2 x 2 raster of a mosaic alike.
LatticeShift MeasureLatticeShift(const cv::Mat& raw,
                                 const cv::Mat& attenuation,
                                 const MicroLensArray& array,
                                 const std::array<float, 4>& by_place);

}  // namespace plenocal::internal
