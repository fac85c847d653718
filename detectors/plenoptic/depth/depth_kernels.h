// SPDX-License-Identifier: Apache-2.0
//
// The inner loops of virtual depth estimation, compiled for several processors and chosen at run
// time.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "detectors/plenoptic/depth/depth_properties.h"
#include "detectors/plenoptic/depth/lens_patches.h"

namespace plenocal::internal {

/// Sets those of `count` pixels in a row to 1 that have texture, the others to 0: known values
/// whose squared gradient exceeds `least` times the variance of a value. Rows of `value` are
/// `stride` floats apart; var(raw) = read + shot * raw.
void FindTexture(const float* value,
                 const float* attenuation,
                 int stride,
                 int count,
                 const SensorNoise& noise,
                 float least,
                 int* textured);

/// Removes the displacement near the edge of a micro image from `count` known or unknown values in
/// a row, `value`; `displaced` are those before, in rows `stride` floats apart, as the
/// attenuation's are `attenuation_stride` apart. `z`: inverse virtual depth.
void RemoveDisplacement(const float* displaced,
                        int stride,
                        const float* attenuation,
                        std::ptrdiff_t attenuation_stride,
                        const float* z,
                        const LinearInZ& vignetting,
                        int count,
                        float* value);

/// Eight columns of a patch from `column` on, rows [top, bottom).
struct PatchBlock {
  int column, top, bottom;
};

/// One patch against another that is shifted by a constant, px.
struct ShiftedPatches {
  const float* reference = nullptr;
  const float* other = nullptr;
  int stride = 0;       ///< of all arrays, floats
  int whole_shift = 0;  ///< floats from a pixel to the one up and left of its shifted position
  float shift_x = 0, shift_y = 0;  ///< the fractional part of the shift, in [0, 1)
  PatchBox overlap{};              ///< pixels that both patches may have
};

/// Adds |other - reference| to `cost` and 1 to `count` (patches) in the parts of the blocks where
/// both patches are known.
void AddDifferences(const ShiftedPatches& patches,
                    std::span<const PatchBlock> blocks,
                    float* cost,
                    float* count);

/// Sums of `cost` over 3 x 3 windows divided by those of `count`; infinite where the latter are
/// less than `least`. Patches of rows of `stride` floats; all windows must lie within the blocks.
void WindowMeans(std::span<const PatchBlock> blocks,
                 int stride,
                 const float* cost,
                 const float* count,
                 float least,
                 float* mean);

/// Pixels of one micro image that have texture, as arrays, each with an inverse virtual depth of
/// its own.
struct TexturedPixels {
  std::vector<float> x, y;  ///< position in the patch, px
  std::vector<float> z;     ///< inverse virtual depth
  std::vector<float> value, gradient_x, gradient_y, laplacian;
  std::vector<float> variance;  ///< noise of the grey value
  std::vector<int> at;          ///< in the patch
  /// Normal equations of the Gauss-Newton step in z: sums of w J e and of w J^2; the step is
  /// -gradient / information.
  std::vector<float> sum_gradient, sum_information;
  std::vector<float> sum_agreement;  ///< of the robust weights, each in [0, 1]
  std::vector<float> sum_count;      ///< number of comparisons

  void ResetSums();
  /// Keeps those whose flag is set.
  void Keep(const std::vector<char>& keep);
};

/// The micro image that pixels are compared with: pixel (x, y) is expected at (x, y) + offset - z *
/// baseline.
struct OtherPatch {
  const float* value = nullptr;
  int size = 0;
  float offset_x = 0, offset_y = 0;
  float baseline_x = 0, baseline_y = 0;  ///< px
  /// Half the variance of its blur less that of the reference, px^2: defocus[0] + defocus[1] * z.
  float defocus[2] = {0, 0};
  float misfit = 0;  ///< px^2: variance of a match that neither noise nor defocus explains
};

/// Adds the comparison with one micro image to the sums of the pixels. A blur of variance s^2
/// changes an image by s^2 / 2 times its Laplacian to first order; this is subtracted from the
/// difference e, for defocus and for the blur of linear interpolation. With J = de/dz the variance
/// of e is 2 * variance + misfit
/// * |gradient along the baseline|^2; Cauchy weights.
void AddEquations(const OtherPatch& other, TexturedPixels* pixels);

/// Sums over the depths in a window that agree with the middle one.
struct WindowSums {
  float information = 0, z = 0;  ///< sum of the information, and of z times it
  float agreeing = 0, all = 0;   ///< number of depths
};

/// The window of `size` <= 8 rows and columns, its first pixel at the arrays' begin. Depths agree
/// whose difference is at most `most` standard deviations. Rows are `stride` floats apart and eight
/// of them are read; a depth of information 0 is none.
WindowSums SumWindow(const float* z, const float* information, int stride, int size, float most);

}  // namespace plenocal::internal
