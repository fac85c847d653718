// SPDX-License-Identifier: Apache-2.0
//
// Rendering of a blurred disc with its derivatives.
#pragma once

#include <Eigen/Core>

#include "detectors/templates/lanes.h"

namespace plenocal::internal {

/// A disc around (0, 0) of a plane, 1 inside and -1 outside, seen through a homography and blurred
/// as a `CellTemplate`: across the edge the profile of a straight edge. A blur s moves the edge of
/// a disc of radius R inward by s^2 / (2 R), for the heat equation moves level lines by their
/// curvature; that is part of the drawing.
class DiscTemplate {
 public:
  explicit DiscTemplate(float radius) : radius_(radius) {}
  void SetRadius(float radius) { radius_ = radius; }

  /// Of eight places at once.
  struct Drawn {
    Lanes value{}, by_u{}, by_v{}, by_blur{}, by_radius{};
    Lanes u{}, v{}, scale{};  ///< place in the plane, third homogeneous coordinate
  };
  /// The drawing at eight (x, y) with derivatives by its place (u, v) in the plane, by the blur and
  /// by the radius. G maps (x, y, 1) to the plane, G(2, 2) = 1; `blur` and
  /// `pixel` as those of a `CellTemplate`.
  void Draw(const Eigen::Matrix3f& G,
            float blur,
            float pixel,
            const Lanes& x,
            const Lanes& y,
            Drawn* drawn) const;

 private:
  float radius_;
};

}  // namespace plenocal::internal
