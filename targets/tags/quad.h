// SPDX-License-Identifier: Apache-2.0
//
// A tag's four corners and the homography that maps a square to them.
#pragma once

#include <Eigen/Core>
#include <array>

namespace plenocal::internal {

/// A tag's corners in a plane: lower left, lower right, upper right, upper left of the upright tag.
using Quad = std::array<Eigen::Vector2d, 4>;

/// Maps (0, 0), (1, 0), (1, 1), (0, 1) to the corners; P. Heckbert, "Fundamentals of Texture
/// Mapping and Image Warping", 1989.
Eigen::Matrix3d UnitSquareHomography(const Quad& q);

}  // namespace plenocal::internal
