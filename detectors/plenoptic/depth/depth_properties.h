// SPDX-License-Identifier: Apache-2.0
//
// Properties of the camera and the scene that matching of micro images needs: the sign and the
// range of the depths, and per lens type the blur, the displacement by vignetting and the errors
// that sensor noise does not explain.
#pragma once

#include <vector>

namespace plenocal::internal {

/// A depth is the mean over this many raw pixels in either direction.
inline constexpr int kDepthWindow = 5;

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

}  // namespace plenocal::internal
