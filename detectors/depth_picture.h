// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>

#include "detectors/virtual_depth.h"

namespace plenocal::internal {

/// A colour picture (8 bits) of the virtual depth for a person's eye, with a bar of colours and
/// numbers on the right. Colours are linear in inverse depth, whose error is alike everywhere;
/// unknown is black.
cv::Mat DepthPicture(const VirtualDepth& depth);

}  // namespace plenocal::internal
