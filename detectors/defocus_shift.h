// SPDX-License-Identifier: Apache-2.0
//
// Where a defocused micro lens shows a point. A sharp point is shown where the ray through the
// middle of the micro lens arrives. A defocused one is a disc, the image of the micro lens'
// aperture in light that falls in obliquely: brighter on the side that is nearer to the pixels, so
// that the disc's centre of light is off its middle in proportion to the distance from the
// micro-image centre c. A disc's size is proportional to the defocus z - z_t of its lens type, z =
// 1 / v, and so is the shift:
//
//   x_measured - c = (1 + lambda_t (z_t - z)) (x - c)
//
// A part that all types share cannot be told from another depth, but the differences between types
// can. Blur tells z_t: its variance is b_t + m (z - z_t)^2.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "calib/observation.h"

namespace plenocal::internal {

/// A marker measured in one micro image, with what its shift depends on.
struct MicroObservation {
  Observation seen;          ///< x, y, lens_x, lens_y
  double inverse_depth = 0;  ///< z
  double blur = 0;           ///< px, standard deviation
  int type = 0;              ///< of the micro lens
};

/// The markers of one raw image by ascending number.
using MicroView = std::vector<MicroObservation>;

/// Finds lambda_t of each type from all views of a camera and takes the shifts out of the
/// measurements. They stay as they are when there is one type, or when the blur does not tell the
/// types' focus or the differences do not tell lambda (five standard deviations each).
void RemoveDefocusShifts(int types, std::vector<MicroView>* views);

}  // namespace plenocal::internal
