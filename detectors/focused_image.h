// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>

#include "detectors/virtual_depth.h"

namespace plenocal::internal {

/// The totally focused image: the virtual image as all micro images see it that have a point of it
/// in view. Pixel (i, j) is at raw px depth.scale * (i, j); CV_32F, raw values without attenuation,
/// filled everywhere.
///
/// Each sample weighs by the inverse of its mean square error: sensor noise (which carries the
/// square of the attenuation) and what the lens type's defocus at that depth takes from local
/// contrast, so that the sharp types decide where there is detail and all where there is none.
/// Samples far from the others count less.
cv::Mat SynthesiseFocused(const VirtualDepth& depth,
                          const LensPatches& patches,
                          const MicroLensArray& array,
                          const MicroLensIndex& index,
                          const SensorNoise& noise,
                          const DepthSurvey& survey,
                          int threads);

}  // namespace plenocal::internal
