// SPDX-License-Identifier: Apache-2.0
//
// Markers measured in the raw image of a plenoptic camera (docs/plenoptic.md, "Markers in micro
// images"). The totally focused image gives the markers and the pose of the target; their
// measurements for the bundle adjustment are made in each micro image by itself, so that every row
// has the errors of its own pixels and none repeats the error of another.
#pragma once

#include <vector>

#include "calib/camera/micro_lens_array.h"
#include "detectors/plenoptic/depth/lens_patches.h"
#include "detectors/plenoptic/depth/virtual_depth.h"
#include "detectors/plenoptic/markers/marker_measurement.h"
#include "detectors/templates/marker_template.h"

namespace plenocal::internal {

/// Measures each marker (positions in raw px of the virtual image) in each micro image that has it
/// well inside, by `FitTemplate`. The blur is common to the micro images of one lens type and one
/// flat part, the radius of discs to all micro images: both are estimated from first fits and fixed
/// by a prior in second ones.
RawMeasurements MeasureMarkers(const std::vector<MarkerTemplate>& markers,
                               const VirtualDepth& depth,
                               const LensPatches& patches,
                               const MicroLensArray& array,
                               const SensorNoise& noise,
                               int threads);

}  // namespace plenocal::internal
