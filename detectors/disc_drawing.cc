// SPDX-License-Identifier: Apache-2.0
#include "detectors/disc_drawing.h"

#include <algorithm>
#include <cmath>

#include "detectors/patch_fit.h"

namespace plenocal::internal {

DiscDrawing::Drawn DiscDrawing::Draw(const Eigen::Matrix3f& G, float blur, float x, float y) const {
  Drawn drawn;
  drawn.scale = G(2, 0) * x + G(2, 1) * y + 1;
  const float inverse = 1 / drawn.scale;
  drawn.u = (G(0, 0) * x + G(0, 1) * y + G(0, 2)) * inverse;
  drawn.v = (G(1, 0) * x + G(1, 1) * y + G(1, 2)) * inverse;
  Eigen::Matrix2f slope;  // of (u, v) by (x, y)
  slope << G(0, 0) - drawn.u * G(2, 0), G(0, 1) - drawn.u * G(2, 1), G(1, 0) - drawn.v * G(2, 0),
      G(1, 1) - drawn.v * G(2, 1);
  slope *= inverse;

  // At the middle itself, where the edge is far, any direction will do.
  const Eigen::Vector2f at(drawn.u, drawn.v);
  const float F = std::max(at.norm(), 1e-6f * radius_);
  const Eigen::Vector2f outward = at / F;
  const Eigen::Vector2f normal = slope.transpose() * outward;  // grad F in the image
  const float steepness = std::max(normal.norm(), 1e-12f);
  // Of the circle's image: how grad F turns along the edge, whose direction there is `along`.
  const Eigen::Vector2f along(-normal.y() / steepness, normal.x() / steepness);
  const float sideways = Eigen::Vector2f(-outward.y(), outward.x()).dot(slope * along);
  const float curvature = sideways * sideways / (radius_ * steepness);
  const float inside = (radius_ - F) / steepness - blur * blur * curvature / 2;
  const EdgeProfile profile = BlurredEdge(inside / blur);
  drawn.value = static_cast<float>(profile.value);
  const float by_inside = static_cast<float>(profile.derivative) / blur;
  drawn.by_u = -by_inside / steepness * outward.x();
  drawn.by_v = -by_inside / steepness * outward.y();
  drawn.by_radius = by_inside / steepness;
  drawn.by_blur = -by_inside * (inside / blur + blur * curvature);
  return drawn;
}

}  // namespace plenocal::internal
