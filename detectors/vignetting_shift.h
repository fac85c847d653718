// SPDX-License-Identifier: Apache-2.0
//
// What the stop of the main lens does to a marker near the edge of a micro image. Where the stop
// cuts into the micro lens' aperture the attenuation V falls, and what a pixel gets is displaced
// (detectors/pixel_depth.h) by
//
//   (k_pixel sqrt(h) + k h) grad ln V,   h = ApertureShape(V)
//
// k_pixel px^2 is the variance of the pixel's own area and point spread, common to all micro
// lenses; k px^2, by lens type and linear in inverse virtual depth, is due to the aperture. The
// gradient is a difference over two pixels, nearly all that V takes to fall: it does not resolve
// that the fall begins as the chord grows which the edge cuts, as sqrt(h). Over profiles of
// apertures that blur by 1.2 to 1.75 px both terms are right within a tenth of the displacement
// from V = 0.95 down. A marker that is fitted to such pixels moves by each k times a vector, its
// pull, that follows from the fit. Near the middle of a micro image there is none, so that k can be
// told from another depth.
#pragma once

#include <vector>

#include "detectors/micro_observation.h"

namespace plenocal::internal {

/// h(V), which makes up for that the aperture ends: an even disc of which a straight edge leaves V
/// is displaced by h k grad ln V, with k that of a bell-shaped aperture of the same width. It is
/// 4/3 (1 - d^2) with the edge at d radii, to 0.02.
double ApertureShape(double V);

/// Finds k_pixel and k of each lens type from all views of a camera, by how the micro images of a
/// marker disagree, and takes the shifts out of the measurements. What remains of them, since k is
/// uncertain, all measurements share: returns it as in `View::shared_errors`, by view.
std::vector<std::vector<std::vector<double>>> RemoveVignettingShifts(int types,
                                                                     std::vector<MicroView>* views);

}  // namespace plenocal::internal
