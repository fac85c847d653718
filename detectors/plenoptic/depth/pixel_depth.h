// SPDX-License-Identifier: Apache-2.0
//
// Inverse virtual depth z = 1 / v of the pixels of a raw plenoptic image, each from its own micro
// image and the neighbours (docs/plenoptic.md, "Depth estimation"; Zeller, Quint, Stilla:
// "Establishing a probabilistic depth map from focused plenoptic cameras", 3DV 2015). A point that
// has its image at x in the micro image around c has it in the one around c' at
//
//   x' = x + d (1 - z),   d = c' - c
//
// Near its edge a micro image is displaced (docs/plenoptic.md, "Vignetting displaces"). To first
// order
//
//   raw / V = I + k grad I . grad V / V,   V the attenuation, k px^2 linear in z, by lens type.
#pragma once

#include <vector>

#include "detectors/plenoptic/depth/depth_properties.h"
#include "detectors/plenoptic/depth/lens_patches.h"
#include "detectors/plenoptic/depth/micro_lens_index.h"

namespace plenocal::internal {

/// One estimate: inverse virtual depth of a raw pixel with its variance.
struct PixelDepth {
  float x = 0, y = 0;  ///< relative to the micro-image centre, px
  float z = 0;
  float variance = 0;
};

/// Estimates of one micro image.
using LensDepth = std::vector<PixelDepth>;

/// Depth of all pixels with texture, one entry per micro lens. Removes the displacement near the
/// edges of the micro images from `patches` on the way.
std::vector<LensDepth> MatchMicroImages(const MicroLensIndex& index,
                                        const SensorNoise& noise,
                                        const DepthSurvey& survey,
                                        int threads,
                                        LensPatches* patches);

}  // namespace plenocal::internal
