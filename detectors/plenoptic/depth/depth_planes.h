// SPDX-License-Identifier: Apache-2.0
//
// Planes of virtual depth of a target's flat parts.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "detectors/plenoptic/depth/virtual_depth.h"

namespace plenocal::internal {

/// A flat part of a target in a map of the virtual image: a convex polygon, px of the map.
using FlatPart = std::vector<cv::Point2f>;

/// Virtual depth of a plane in the scene at q, raw px: v = dot(by_q, (q, 1)). It is affine because
/// virtual depth is a + b / z_C for a point at distance z_C, and 1 / z_C is affine in the image of
/// a plane.
struct DepthPlane {
  Eigen::Vector3d by_q;
  Eigen::Matrix3d covariance;  ///< of `by_q`
};

/// Robust fit to the known depths inside a part; nothing for fewer than three.
std::optional<DepthPlane> FitDepthPlane(const VirtualDepth& depth, const FlatPart& part);

/// Replaces the depth in each part by its plane; returns the number of parts with a plane.
size_t FlattenParts(const std::vector<FlatPart>& parts, VirtualDepth* depth);

}  // namespace plenocal::internal
