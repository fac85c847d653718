// SPDX-License-Identifier: Apache-2.0
//
// The two inner loops of virtual depth estimation, compiled for several processors and chosen at
// run time.
#pragma once

namespace plenocal::internal {

/// One patch against another that is shifted by a constant, px.
struct ShiftedPatches {
  const float* reference = nullptr;  ///< first value of the overlap in the reference patch
  const float* other = nullptr;      ///< the pixel up and left of its shifted position
  int stride = 0;                    ///< of all arrays, floats
  int rows = 0, columns = 0;  ///< of the overlap; columns are rounded up to whole blocks of eight
  float shift_x = 0, shift_y = 0;  ///< the fractional part of the shift, in [0, 1)
};

/// Adds |other - reference| to `cost` and 1 to `count` (arrays that begin at the overlap) where
/// both patches are known.
void AddDifferences(const ShiftedPatches& patches, float* cost, float* count);

/// Sums of `cost` over 3 x 3 windows divided by those of `count`; infinite where the latter are
/// less than `least`. Arrays of rows * columns floats; the outermost rows and columns of `mean` are
/// undefined. `work`: 2 * rows * columns floats.
void WindowMeans(int columns,
                 int rows,
                 const float* cost,
                 const float* count,
                 float least,
                 float* work,
                 float* mean);

/// Pixels of one micro image, each with an inverse virtual depth of its own. Arrays of `count`
/// floats.
struct DepthPixels {
  int count = 0;
  const float* x = nullptr;  ///< position in the patch, px
  const float* y = nullptr;
  const float* z = nullptr;      ///< inverse virtual depth
  const float* value = nullptr;  ///< grey value
  const float* gradient_x = nullptr;
  const float* gradient_y = nullptr;
  const float* laplacian = nullptr;
  const float* variance = nullptr;  ///< noise of the grey value
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

/// Normal equations of the Gauss-Newton step in z and measures of agreement, one entry per pixel.
struct DepthEquations {
  float* gradient = nullptr;     ///< sum of w J e: the step is -gradient / information
  float* information = nullptr;  ///< sum of w J^2
  float* agreement = nullptr;    ///< sum of the robust weights, each in [0, 1]
  float* count = nullptr;        ///< number of comparisons
};

/// Adds the comparison with one micro image. A blur of variance s^2 changes an image by s^2 / 2
/// times its Laplacian to first order; this is subtracted from the difference e, for defocus and
/// for the blur of linear interpolation. With J = de/dz the variance of e is 2 * variance + misfit
/// * |gradient along the baseline|^2; Cauchy weights.
void AddEquations(const DepthPixels& pixels, const OtherPatch& other, const DepthEquations& sums);

}  // namespace plenocal::internal
