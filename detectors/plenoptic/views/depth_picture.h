// SPDX-License-Identifier: Apache-2.0
//
// Pictures of virtual depth for viewing and for other programs.
#pragma once

#include <opencv2/core/mat.hpp>
#include <string>
#include <utility>

#include "detectors/plenoptic/depth/virtual_depth.h"

namespace plenocal::internal {

/// The lowest and the highest known inverse depth but for one in a hundred at either end, which may
/// be outliers; 0 and 1 where none is known.
std::pair<float, float> UsualRange(const VirtualDepth& depth);

/// A colour picture (8 bits) of the virtual depth for inspection, with a bar of colours and
/// numbers on the right. Colours are linear in inverse depth, whose error is uniform;
/// unknown is black.
cv::Mat DepthPicture(const VirtualDepth& depth);

/// The same of at most 1000 pixels a side, as the content of a JPEG file: what report.html shows.
std::string SampleDepthPicture(const VirtualDepth& depth);

/// Virtual depth in the convention of Raytrix' RxLive: CV_16U, 65535 (1 - 1 / v), 0 where it is
/// unknown or, of a Keplerian camera, negative.
cv::Mat RxLiveDepth(const VirtualDepth& depth);

}  // namespace plenocal::internal
