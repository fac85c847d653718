// SPDX-License-Identifier: Apache-2.0
//
// Markers measured in the raw image of a plenoptic camera.
//
// The totally focused image says which markers there are and how the target lies; what is handed to
// the bundle adjustment is measured anew in every micro image, so that its errors are those of that
// micro image's own pixels and not copies of one error.
#pragma once

#include <vector>

#include "calib/micro_lens_array.h"
#include "calib/observation.h"
#include "detectors/lens_patches.h"
#include "detectors/marker_looks.h"
#include "detectors/micro_observation.h"
#include "detectors/virtual_depth.h"

namespace plenocal::internal {

/// For each look (places in raw px of the virtual image) and each micro image that has its marker
/// well inside: the marker's place (x, y, lens_x, lens_y), raw px, with its sigma.
///
/// Around the predicted place the target's drawing is fitted to the micro image by its shift,
/// brightness, contrast and blur. The blur is common to the micro images of one lens type and one
/// flat part. Sigma comes from the fit's own residuals, or from the sensor's noise where that is
/// larger. Pixels that have lost more than a quarter of their micro image's light are not used: the
/// light of the neighbouring micro image falls on them, and it takes more than `pull` to say what
/// the stop does there; of a disc all of the edge must be lit. Micro images in which the fit fails
/// or moves by more than half a cell are left out.
MicroView MeasureInMicroImages(const std::vector<MarkerLook>& looks,
                               const VirtualDepth& depth,
                               const LensPatches& patches,
                               const MicroLensArray& array,
                               const SensorNoise& noise,
                               int threads);

}  // namespace plenocal::internal
