// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "calib/observation.h"

namespace plenocal::internal {

/// A colour picture (8 bits) of an image (CV_8U) with a cross and the number at each marker, for a
/// person's eye.
cv::Mat MarkerPicture(const cv::Mat& gray, const std::vector<Observation>& markers);

}  // namespace plenocal::internal
