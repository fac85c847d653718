// SPDX-License-Identifier: Apache-2.0
//
// Synthesis of the totally focused image.
#pragma once

#include <opencv2/core/mat.hpp>

#include "detectors/plenoptic/depth/virtual_depth.h"

namespace plenocal::internal {

/// The totally focused image: the virtual image, combined from all micro images that see each of
/// its points (docs/plenoptic.md, "Totally focused image"). Pixel (i, j) is at raw px
/// depth.scale * (i, j); CV_32F, raw values without attenuation, filled everywhere.
///
/// Each sample weighs by the inverse of its mean square error: sensor noise (which carries the
/// square of the attenuation) and the local contrast that the lens type's defocus at that depth
/// removes. So the sharp types decide where there is detail, and all types where there is none.
/// Samples far from the others count less.
cv::Mat SynthesiseFocusedImage(const VirtualDepth& depth,
                               const LensPatches& patches,
                               const MicroLensIndex& index,
                               const SensorNoise& noise,
                               const DepthSurvey& survey,
                               int threads);

/// Factor that brings an image (CV_32F) to 8 bits: one in a thousand pixels may saturate.
double ScaleTo8Bits(const cv::Mat& image);

}  // namespace plenocal::internal
