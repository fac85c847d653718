// SPDX-License-Identifier: Apache-2.0
//
// A spline over the image: what the lens does beyond a stereographic projection is a smooth field
// that each part of the image has for itself. `splined-20x14` has 20 x 14 knots, `splined2-20x14`
// is of order 2.
//
// Source: mrcal, splined stereographic lens models (mrcal.secretsauce.net/splined-models.html),
// LENSMODEL_SPLINED_STEREOGRAPHIC. With d = |p_C| and B the uniform B-spline of order n:
//
//   u = 2 (x_C, y_C) / (d + z_C)                                     (radius 2 tan(theta / 2))
//   s = (N_x - n) / (4 tan(fov / 4))                                 (knots a unit of u)
//   i = s u_x + (N_x - 1) / 2, j = s u_y + (N_y - 1) / 2             (place among the knots)
//   m = u + sum over knots (a, b) of B(i - a) B(j - b) (x_a_b, y_a_b)
//   (x_Id, y_Id) = (f_x m_x + c_x, f_y m_y + c_y)                    (pixels)
//
// A point depends on the (n + 1)^2 knots around it. Between the outermost knots and the next,
// mrcal's polynomial of the last full cell holds. Defined over the rectangle of the knots, as far
// as the map does not fold.
//
// Spline and f_x, f_y, c_x, c_y can do the same, so these and fov are chosen before the adjustment
// and fixed. A rotation of the camera is a quadratic field in u, which the spline contains: one
// knot in the middle and half of one to its right are fixed: they define the rotation of the
// camera's frame.
#pragma once

#include "models/spline/spline_lens.h"

namespace plenocal {

struct Splined {
  static CameraModel Table();  // in models/spline/spline_family.cc

  /// The knots of a model of this family; null for others.
  static const SplineLens* LensOf(const CameraModel& model);
  /// Name of the member: "splined-20x14".
  static std::string NameOf(const SplineLens& lens);
};

}  // namespace plenocal
