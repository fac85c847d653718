// SPDX-License-Identifier: Apache-2.0
#include "detectors/templates/disc_template.h"

#include "calib/kernels/processors.h"

namespace plenocal::internal {

PLENOCAL_FOR_EACH_PROCESSOR void DiscTemplate::Draw(const Eigen::Matrix3f& G,
                                                    float blur,
                                                    float pixel,
                                                    const Lanes& x,
                                                    const Lanes& y,
                                                    Drawn* drawn) const {
  drawn->scale = G(2, 0) * x + G(2, 1) * y + 1;
  const Lanes inverse = 1 / drawn->scale;
  const Lanes u = (G(0, 0) * x + G(0, 1) * y + G(0, 2)) * inverse;
  const Lanes v = (G(1, 0) * x + G(1, 1) * y + G(1, 2)) * inverse;
  const Lanes u_x = (G(0, 0) - u * G(2, 0)) * inverse, u_y = (G(0, 1) - u * G(2, 1)) * inverse;
  const Lanes v_x = (G(1, 0) - v * G(2, 0)) * inverse, v_y = (G(1, 1) - v * G(2, 1)) * inverse;

  // At the middle itself, where the edge is far, any direction will do.
  const auto at_least = [](float least, Lanes* lanes) {
    *lanes = *lanes > least ? *lanes : Lanes{} + least;
  };
  Lanes F = u * u + v * v;
  Sqrt(&F);
  at_least(1e-6f * radius_, &F);
  const Lanes outward_u = u / F, outward_v = v / F;
  // grad F in the image
  const Lanes F_x = u_x * outward_u + v_x * outward_v, F_y = u_y * outward_u + v_y * outward_v;
  Lanes steepness = F_x * F_x + F_y * F_y;
  Sqrt(&steepness);
  at_least(1e-12f, &steepness);
  // Of the circle's image: how grad F turns along the edge, whose direction there is `along`.
  const Lanes along_x = -F_y / steepness, along_y = F_x / steepness;
  const Lanes sideways =
      outward_u * (v_x * along_x + v_y * along_y) - outward_v * (u_x * along_x + u_y * along_y);
  const Lanes curvature = sideways * sideways / (radius_ * steepness);
  const Lanes inside = (radius_ - F) / steepness - 0.5f * blur * blur * curvature;
  Lanes distribution, density, bend;
  StepBlur edge(Lanes{} + blur);
  if (pixel > 0) {
    Lanes split;
    PixelSplit(F_x, F_y, pixel, &split);
    edge = StepBlur(Lanes{} + blur, split);
  }
  edge.At(inside, &distribution, &density, &bend);
  drawn->u = u;
  drawn->v = v;
  drawn->value = 2 * distribution - 1;
  const Lanes by_inside = 2 / blur * density;
  drawn->by_u = -by_inside / steepness * outward_u;
  drawn->by_v = -by_inside / steepness * outward_v;
  drawn->by_radius = by_inside / steepness;
  drawn->by_blur = 2 / blur * bend - by_inside * blur * curvature;
}

}  // namespace plenocal::internal
