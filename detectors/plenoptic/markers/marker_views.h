// SPDX-License-Identifier: Apache-2.0
//
// Measured markers as observations for the bundle adjustment, with what two systematic errors do to
// them (docs/plenoptic.md, "Corrections"). The adjustment estimates both: the displacement by
// vignetting as nuisance parameters, that by a wrong depth by the depth which the camera's model
// gives each marker.
#pragma once

#include <string>
#include <vector>

#include "calib/camera/observation.h"
#include "detectors/plenoptic/markers/marker_measurement.h"

namespace plenocal {

/// The views of a camera from the measurements of all its raw images, parallel to `frames`. Images
/// without measurements have no view. `tilted`: vignetting changes across the array, too.
std::vector<View> MarkerViews(const std::vector<std::string>& frames,
                              int lens_types,
                              const std::vector<internal::RawMeasurements>& images,
                              bool tilted);

}  // namespace plenocal
