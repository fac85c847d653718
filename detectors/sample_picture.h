// SPDX-License-Identifier: Apache-2.0
//
// What report.html shows of one image of a camera: JPEG files of at most 1000 pixels a side.
#pragma once

#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "calib/observation.h"
#include "detectors/virtual_depth.h"

namespace plenocal::internal {

/// An image (CV_8U) with its markers drawn (`MarkerPicture`), as the content of a JPEG file.
std::string SamplePicture(const cv::Mat& gray, std::vector<Observation> markers);

/// Virtual depth in colours (`DepthPicture`), as the content of a JPEG file.
std::string SampleDepthPicture(const VirtualDepth& depth);

}  // namespace plenocal::internal
