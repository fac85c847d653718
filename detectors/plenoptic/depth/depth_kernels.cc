// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/depth_kernels.h"

#include <algorithm>
#include <limits>

#include "calib/base/robust.h"
#include "calib/kernels/processors.h"
#include "detectors/templates/lanes.h"

namespace plenocal::internal {

PLENOCAL_FOR_EACH_PROCESSOR
void FindTexture(const float* value,
                 const float* attenuation,
                 int stride,
                 int count,
                 const SensorNoise& noise,
                 float least,
                 int* textured) {
  const float* above = value - stride;
  const float* below = value + stride;
#ifndef __clang__
#pragma GCC ivdep
#endif
  for (int i = 0; i < count; ++i) {
    const float own = value[i], v = attenuation[i];
    const float gx = (value[i + 1] - value[i - 1]) / 2, gy = (below[i] - above[i]) / 2;
    const float variance = (noise.read + noise.shot * (own > 0 ? own : 0) * v) / (v * v);
    textured[i] = own == own && gx * gx + gy * gy > least * variance ? 1 : 0;
  }
}

namespace {

/// Half the difference across a pixel, one-sided at the edge of the known values.
PLENOCAL_LANES float Slope(float before, float here, float after) {
  const float both = (after - before) / 2, right = after - here, left = 1.5f * (here - before);
  return both == both ? both : right == right ? right : left == left ? left : 0;
}

/// Half the difference of a logarithm, (a - b) / (a + b), whose two pixels have one colour in a
/// mosaic.
PLENOCAL_LANES float LogSlope(float before, float after) {
  return (after - before) / (after + before);
}

}  // namespace

PLENOCAL_FOR_EACH_PROCESSOR
void RemoveDisplacement(const float* displaced,
                        int stride,
                        const float* attenuation,
                        std::ptrdiff_t attenuation_stride,
                        const float* z,
                        const LinearInZ& vignetting,
                        int count,
                        float* value) {
  const LinearInZ k = vignetting;
  const float* __restrict here = displaced;
  const float* __restrict above = displaced - stride;
  const float* __restrict below = displaced + stride;
  const float* __restrict v = attenuation;
  const float* __restrict v_above = attenuation - attenuation_stride;
  const float* __restrict v_below = attenuation + attenuation_stride;
  const float* __restrict depth = z;
  float* __restrict out = value;
  for (int i = 0; i < count; ++i) {
    const float along = Slope(here[i - 1], here[i], here[i + 1]) * LogSlope(v[i - 1], v[i + 1]) +
                        Slope(above[i], here[i], below[i]) * LogSlope(v_above[i], v_below[i]);
    out[i] = here[i] - k.At(depth[i]) * along;
  }
}

PLENOCAL_FOR_EACH_PROCESSOR
void AddDifferences(const ShiftedPatches& patches,
                    std::span<const PatchBlock> blocks,
                    float* cost,
                    float* count) {
  const PatchBox& overlap = patches.overlap;
  const float fx = patches.shift_x, fy = patches.shift_y;
  const int stride = patches.stride;
  for (const PatchBlock& block : blocks) {
    if (block.column + kLanes <= overlap.left || block.column >= overlap.right) continue;
    const int top = std::max(block.top, overlap.top);
    const int bottom = std::min(block.bottom, overlap.bottom);
    if (top >= bottom) continue;
    int at = top * stride + block.column;
    const float* other = patches.other + at + patches.whole_shift;
    Lanes left, right, reference, costs, counts;
    Load(other, &left);
    Load(other + 1, &right);
    Lanes upper = left + fx * (right - left);
    for (int row = top; row < bottom; ++row, at += stride) {
      other += stride;
      Load(other, &left);
      Load(other + 1, &right);
      Load(patches.reference + at, &reference);
      Load(cost + at, &costs);
      Load(count + at, &counts);
      const Lanes lower = left + fx * (right - left);
      const Lanes difference = upper + fy * (lower - upper) - reference;
      const Lanes size = difference < 0 ? -difference : difference;
      costs += size > 0 ? size : Lanes{};  // not where it is unknown
      counts += size >= 0 ? Lanes{} + 1 : Lanes{};
      Store(costs, cost + at);
      Store(counts, count + at);
      upper = lower;
    }
  }
}

namespace {

/// Sums of three values beside each other, the middle one at `middle`.
PLENOCAL_LANES void SumOfThree(const float* middle, Lanes* sum) {
  Lanes left, right;
  Load(middle - 1, &left);
  Load(middle, sum);
  Load(middle + 1, &right);
  *sum += left + right;
}

}  // namespace

PLENOCAL_FOR_EACH_PROCESSOR
void WindowMeans(std::span<const PatchBlock> blocks,
                 int stride,
                 const float* cost,
                 const float* count,
                 float least,
                 float* mean) {
  for (const PatchBlock& block : blocks) {
    int at = block.top * stride + block.column;
    Lanes costs[3], counts[3];  // of three rows
    for (int row = 0; row < 2; ++row) {
      SumOfThree(cost + at + row * stride, &costs[row]);
      SumOfThree(count + at + row * stride, &counts[row]);
    }
    for (int row = block.top + 1; row + 1 < block.bottom; ++row) {
      at += stride;
      SumOfThree(cost + at + stride, &costs[2]);
      SumOfThree(count + at + stride, &counts[2]);
      const Lanes all = counts[0] + counts[1] + counts[2];
      const Lanes sum = costs[0] + costs[1] + costs[2];
      Store(all >= least ? sum / all : Lanes{} + std::numeric_limits<float>::infinity(), mean + at);
      costs[0] = costs[1], costs[1] = costs[2];
      counts[0] = counts[1], counts[1] = counts[2];
    }
  }
}

PLENOCAL_FOR_EACH_PROCESSOR
void AddEquations(const OtherPatch& patch, TexturedPixels* pixels) {
  const OtherPatch other =
      patch;  // copies, so that the compiler sees that the sums do not change them
  const int pixel_count = static_cast<int>(pixels->x.size());
  // Cauchy's weight over the variance, 1 / (variance + e^2 / width^2): one division gives both.
  constexpr float kInverseScale = 1 / kCauchyWidthSquared<float>;
  const float inverse_length =
      1 / (other.baseline_x * other.baseline_x + other.baseline_y * other.baseline_y);
  const float* __restrict x = pixels->x.data();
  const float* __restrict y = pixels->y.data();
  const float* __restrict z = pixels->z.data();
  const float* __restrict values = pixels->value.data();
  const float* __restrict gradient_x = pixels->gradient_x.data();
  const float* __restrict gradient_y = pixels->gradient_y.data();
  const float* __restrict laplacians = pixels->laplacian.data();
  const float* __restrict variances = pixels->variance.data();
  const float* __restrict others = other.value;
  float* __restrict gradient = pixels->sum_gradient.data();
  float* __restrict information = pixels->sum_information.data();
  float* __restrict agreement = pixels->sum_agreement.data();
  float* __restrict count = pixels->sum_count.data();
  const int size = other.size, last = size - 2;
#ifndef __clang__
#pragma GCC ivdep  // the sums are arrays of their own
#endif
  for (int i = 0; i < pixel_count; ++i) {
    // Outside of the patch values are unknown, as in its margin.
    const float u = x[i] + other.offset_x - other.baseline_x * z[i];
    const float v = y[i] + other.offset_y - other.baseline_y * z[i];
    int column = static_cast<int>(u), row = static_cast<int>(v);
    column = column < 0 ? 0 : column;
    row = row < 0 ? 0 : row;
    column = column > last ? last : column;
    row = row > last ? last : row;
    const float fx = u - static_cast<float>(column), fy = v - static_cast<float>(row);
    const int at = row * size + column;
    const float upper = others[at] + fx * (others[at + 1] - others[at]);
    const float lower = others[at + size] + fx * (others[at + size + 1] - others[at + size]);
    // Linear interpolation at fraction f has the variance f (1 - f).
    const float blur =
        other.defocus[0] + other.defocus[1] * z[i] + (fx * (1 - fx) + fy * (1 - fy)) / 4;
    const float difference = upper + fy * (lower - upper) - values[i] - blur * laplacians[i];
    const bool known = difference == difference;
    const float error = known ? difference : 0.f;
    const float slope = -(other.baseline_x * gradient_x[i] + other.baseline_y * gradient_y[i]);
    const float variance = 2 * variances[i] + other.misfit * slope * slope * inverse_length;
    const float robust = 1 / (variance + kInverseScale * error * error);
    const float weight = known ? robust : 0.f;
    gradient[i] += weight * slope * error;
    information[i] += weight * slope * slope;
    agreement[i] += weight * variance;
    count[i] += known ? 1.f : 0.f;
  }
}

PLENOCAL_FOR_EACH_PROCESSOR
WindowSums SumWindow(const float* z, const float* information, int stride, int size, float most) {
  const int middle = size / 2 * (stride + 1);
  const float own_z = z[middle], own = information[middle];
  const Lanes column = {0, 1, 2, 3, 4, 5, 6, 7};
  const auto in_window = column < static_cast<float>(size);
  Lanes sum_information{}, sum_z{}, agreeing{}, all{};
  for (int row = 0; row < size; ++row) {
    Lanes others, weights;
    Load(z + row * stride, &others);
    Load(information + row * stride, &weights);
    const Lanes off = others - own_z;
    const auto known = in_window & (weights > 0);
    const auto agrees = known & (off * off * weights * own <= most * most * (weights + own));
    all += known ? Lanes{} + 1 : Lanes{};
    agreeing += agrees ? Lanes{} + 1 : Lanes{};
    sum_information += agrees ? weights : Lanes{};
    sum_z += agrees ? weights * others : Lanes{};
  }
  return {Sum(sum_information), Sum(sum_z), Sum(agreeing), Sum(all)};
}

}  // namespace plenocal::internal
