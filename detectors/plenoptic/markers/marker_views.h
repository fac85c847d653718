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

/// Nuisance parameters besides k_pixel and k of each lens type.
enum class FurtherErrors {
  kNone,
  kAcrossArray,   ///< of a tilted array: changes of k across it
  kVirtualDepth,  ///< of a scene of unknown scale: factors of the virtual depth
};

/// The views of a camera from the measurements of all its raw images, parallel to `frames`. Images
/// without measurements have no view.
std::vector<View> MarkerViews(const std::vector<std::string>& frames,
                              int lens_types,
                              const std::vector<internal::RawMeasurements>& images,
                              FurtherErrors further);

}  // namespace plenocal
