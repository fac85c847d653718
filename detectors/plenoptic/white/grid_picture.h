// SPDX-License-Identifier: Apache-2.0
//
// A picture of the grid of micro lenses.
#pragma once

#include <opencv2/core/mat.hpp>

#include "calib/camera/micro_lens_array.h"

namespace plenocal {

/// A colour picture (8 bits) of the grid over the white image, for inspection: on the left the
/// whole array, with a circle in the colour of its type around each micro lens and a red cross on
/// each unusable one; on the right a corner, the middle and the opposite corner enlarged, with
/// crosses at the centres.
cv::Mat GridPicture(const cv::Mat& white, const MicroLensArray& array);

}  // namespace plenocal
