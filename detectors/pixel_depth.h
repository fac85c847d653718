// SPDX-License-Identifier: Apache-2.0
//
// Inverse virtual depth z = 1 / v of the pixels of a raw plenoptic image, each from its own micro
// image and the neighbours (Zeller, Quint, Stilla: "Establishing a probabilistic depth map from
// focused plenoptic cameras", 3DV 2015). What is seen at x in the micro image around c is seen in
// the one around c' at
//
//   x' = x + d (1 - z),   d = c' - c
//
// Near its edge a micro image is shifted. What a pixel gets came through some place of the micro
// lens' aperture and of the pixel, which displaces both the image and the shadow of the main lens'
// stop that makes the attenuation V. Their displacements, summed over aperture and pixel, are
// correlated; so V I is blurred together, and to first order
//
//   raw / V = I + k grad I . grad V / V,   k = covariance of the two, px^2
//
// The displacement by an aperture point p is p (z_t - z) for the image and p z_t for the shadow,
// where z_t is what the lens type has in focus; so k is linear in z, by lens type, and so much of
// it as the pixel's own area makes is common to all.
#pragma once

#include <array>
#include <vector>

#include "calib/micro_lens_array.h"
#include "detectors/lens_patches.h"
#include "detectors/micro_lens_index.h"

namespace plenocal::internal {

/// Range of inverse virtual depth.
struct ZRange {
  float lowest = 0, highest = 0;
};

/// What the image says about the camera and what single matches need to know of it.
struct DepthSurvey {
  ZRange range;   ///< all that the camera can measure; negative for a Keplerian camera
  ZRange likely;  ///< where the depths of the survey lie, and some margin
  /// Per lens type half the variance of its blur, px^2, less the mean over all types, as defocus[0]
  /// + defocus[1] * z. The blur of a thin lens is a disc whose diameter is linear in z, with one
  /// factor for all types, so differences of its square are linear.
  std::vector<std::array<float, 2>> defocus;
  /// k of each type, px^2, as vignetting[0] + vignetting[1] * z.
  std::vector<std::array<float, 2>> vignetting;
  /// types x types, px^2: variance of a match between two lens types that neither sensor noise nor
  /// defocus explains.
  std::vector<float> misfit;
};

/// One estimate: inverse virtual depth of a raw pixel with its variance.
struct PixelDepth {
  float x = 0, y = 0;  ///< relative to the micro-image centre, px
  float z = 0;
  float variance = 0;
};

/// Estimates of one micro image.
using LensDepth = std::vector<PixelDepth>;

/// Tells Galilean (z > 0) from Keplerian (z < 0), and measures the misfits, on micro images spread
/// over the image.
DepthSurvey SurveyDepth(const LensPatches& patches,
                        const MicroLensArray& array,
                        const MicroLensIndex& index,
                        const SensorNoise& noise,
                        int threads);

/// Depth of all pixels with texture, one entry a micro lens. On the way the shift near the edges is
/// taken out of `patches`.
std::vector<LensDepth> MatchMicroImages(const MicroLensArray& array,
                                        const MicroLensIndex& index,
                                        const SensorNoise& noise,
                                        const DepthSurvey& survey,
                                        int threads,
                                        LensPatches* patches);

}  // namespace plenocal::internal
