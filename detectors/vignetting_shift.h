// SPDX-License-Identifier: Apache-2.0
//
// What the stop of the main lens does to a marker near the edge of a micro image. Where the stop
// cuts into the micro lens' aperture the attenuation V falls, and what a pixel gets is displaced by
// k grad ln V (detectors/pixel_depth.h), k px^2 linear in inverse virtual depth by lens type. A
// marker that is fitted to such pixels moves by k times a vector, its pull, that follows from the
// fit. Near the middle of a micro image there is none, so that k can be told from another depth.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "calib/observation.h"

namespace plenocal::internal {

/// A marker measured in one micro image, with what its shift depends on.
struct MicroObservation {
  Observation seen;            ///< x, y, lens_x, lens_y
  double inverse_depth = 0;    ///< 1 / v
  Eigen::Vector2d pull{0, 0};  ///< change of (x, y) with k, 1 / px
  int type = 0;                ///< of the micro lens
};

/// The markers of one raw image by ascending number.
using MicroView = std::vector<MicroObservation>;

/// Finds k of each lens type from all views of a camera, by how the micro images of a marker
/// disagree, and takes the shifts out of the measurements. What remains of them, since k is
/// uncertain, all measurements share: returns it as in `View::shared_errors`, by view.
std::vector<std::vector<std::vector<double>>> RemoveVignettingShifts(int types,
                                                                     std::vector<MicroView>* views);

}  // namespace plenocal::internal
