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

/// Error of matching that all pixels of a part share, part of its depth, for micro images of one
/// pixel; inverse to their pitch. It is by pattern and depth, not by sensor noise (bench/README.md,
/// "Plenoptic cameras").
inline constexpr double kCommonError = 0.0145;

/// Replaces the depth in each part by its plane; returns the number of parts with a plane.
/// `common_error`: of the depths in a part, part of them; included in sigma.
size_t FlattenParts(const std::vector<FlatPart>& parts, double common_error, VirtualDepth* depth);

}  // namespace plenocal::internal
