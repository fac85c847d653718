// SPDX-License-Identifier: Apache-2.0
//
// Measurement of what matching needs, in a sample of the micro images of one raw image
// (docs/plenoptic.md, "Depth estimation").
#pragma once

#include "detectors/plenoptic/depth/depth_properties.h"
#include "detectors/plenoptic/depth/lens_patches.h"
#include "detectors/plenoptic/depth/micro_lens_index.h"

namespace plenocal::internal {

DepthSurvey SurveyDepth(const LensPatches& patches,
                        const MicroLensIndex& index,
                        const SensorNoise& noise,
                        int threads);

}  // namespace plenocal::internal
