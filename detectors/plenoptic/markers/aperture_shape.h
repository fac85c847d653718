// SPDX-License-Identifier: Apache-2.0
//
// Displacement of markers near the edges of micro images by vignetting (docs/plenoptic.md,
// "Vignetting displaces"). Where the stop of the main lens cuts into the micro lens' aperture the
// attenuation V falls, and the light of a pixel is displaced by
//
//   (k_pixel sqrt(h) + k h) grad ln V,   h = ApertureShape(V)
//
// k_pixel, px^2, is the variance of the pixel's own area and point spread, common to all micro
// lenses; k, px^2, by lens type and linear in inverse virtual depth, is due to the aperture. The
// gradient is a difference over two pixels, nearly the width over which V falls: it does not
// resolve that the fall begins with the length of the cut chord, as sqrt(h). For profiles of
// apertures that blur by 1.2 to 1.75 px both terms are right within a tenth of the displacement
// from V = 0.95 down.
//
// A marker that is fitted to such pixels moves by each k times a vector, its vignetting
// sensitivity, which follows from the fit. Near the middle of a micro image that vector is zero, so
// that k can be distinguished from another depth.
#pragma once

#include <Eigen/Core>

#include "detectors/plenoptic/depth/lens_patches.h"

namespace plenocal::internal {

/// h(V), the correction for the finite aperture: an even disc of which a straight edge leaves V is
/// displaced by h k grad ln V, with k that of a bell-shaped aperture of the same width. It is
/// 4/3 (1 - d^2) with the edge at d radii, to 0.02.
double ApertureShape(double V);

/// Displacement of a pixel of a micro image by vignetting, px, per px^2 of k_pixel and of k: two
/// columns. `V`: its attenuation over the highest of the micro image.
Eigen::Matrix2d VignettingDisplacement(
    const LensPatches& patches, size_t lens, float V, int column, int row);

}  // namespace plenocal::internal
