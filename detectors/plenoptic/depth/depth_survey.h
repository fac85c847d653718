// SPDX-License-Identifier: Apache-2.0
//
// Properties of the camera and the scene that matching needs, measured in a sample of the micro
// images of one raw image (docs/plenoptic.md, "Depth estimation"): the sign and the range of the
// depths, and per lens type the blur, the displacement by vignetting and the errors that sensor
// noise does not explain.
#pragma once

#include <vector>

#include "detectors/plenoptic/depth/lens_patches.h"
#include "detectors/plenoptic/depth/micro_lens_index.h"

namespace plenocal::internal {

/// Range of inverse virtual depth.
struct ZRange {
  float lowest = 0, highest = 0;
};

/// A quantity that is linear in inverse virtual depth.
struct LinearInZ {
  float offset = 0, slope = 0;
  [[nodiscard]] float At(float z) const { return offset + slope * z; }
};

struct DepthSurvey {
  ZRange range;   ///< all that the camera can measure; negative for a Keplerian camera
  ZRange likely;  ///< the depths in the sample, with a margin
  /// Per lens type: half the variance of its blur, px^2, less the mean over all types. The blur of
  /// a thin lens is a disc whose diameter is linear in z, with one factor for all types, so
  /// differences of its square are linear.
  std::vector<LinearInZ> defocus;
  /// Per lens type: k of the displacement by vignetting, px^2.
  std::vector<LinearInZ> vignetting;
  /// types x types, px^2: variance of a match between two lens types that neither sensor noise nor
  /// defocus explains.
  std::vector<float> misfit;
};

DepthSurvey SurveyDepth(const LensPatches& patches,
                        const MicroLensIndex& index,
                        const SensorNoise& noise,
                        int threads);

}  // namespace plenocal::internal
