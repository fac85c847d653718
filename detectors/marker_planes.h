// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "detectors/virtual_depth.h"

namespace plenocal::internal {

/// A flat part of a target in a map of the virtual image: a convex polygon, px of the map.
using FlatPart = std::vector<cv::Point2f>;

/// Replaces the depth in each part by its plane and returns how many parts had one. Virtual depth
/// is a + b / z_C for a point at distance z_C, and 1 / z_C is affine in the image of a plane; so
/// is, therefore, the virtual depth 1 / inverse.
size_t FlattenParts(const std::vector<FlatPart>& parts, VirtualDepth* depth);

}  // namespace plenocal::internal
