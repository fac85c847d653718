// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/depth_kernels.h"

#include <cmath>
#include <limits>

#include "calib/base/robust.h"
#include "calib/kernels/processors.h"

namespace plenocal::internal {

PLENOCAL_FOR_EACH_PROCESSOR
void AddDifferences(const ShiftedPatches& patches, float* cost, float* count) {
  const float fx = patches.shift_x, fy = patches.shift_y;
  const float w00 = (1 - fx) * (1 - fy), w01 = fx * (1 - fy), w10 = (1 - fx) * fy, w11 = fx * fy;
  const int blocks = (patches.columns + 7) / 8;
  for (int row = 0; row < patches.rows; ++row) {
    const float* __restrict reference = patches.reference + row * patches.stride;
    const float* __restrict upper = patches.other + row * patches.stride;
    const float* __restrict lower = upper + patches.stride;
    float* __restrict cost_row = cost + row * patches.stride;
    float* __restrict count_row = count + row * patches.stride;
#ifndef __clang__
#pragma GCC ivdep
#endif
    for (int i = 0; i < blocks * 8; ++i) {
      const float value = w00 * upper[i] + w01 * upper[i + 1] + w10 * lower[i] + w11 * lower[i + 1];
      const float difference = std::abs(value - reference[i]);
      const bool known = difference == difference;
      cost_row[i] += known ? difference : 0.f;
      count_row[i] += known ? 1.f : 0.f;
    }
  }
}

PLENOCAL_FOR_EACH_PROCESSOR
void WindowMeans(int columns,
                 int rows,
                 const float* cost,
                 const float* count,
                 float least,
                 float* work,
                 float* mean) {
  const int area = rows * columns;
  float* __restrict costs = work;
  float* __restrict counts = work + area;
  for (int i = columns; i < area - columns; ++i) {
    costs[i] = cost[i - columns] + cost[i] + cost[i + columns];
    counts[i] = count[i - columns] + count[i] + count[i + columns];
  }
  for (int i = columns + 1; i < area - columns - 1; ++i) {
    const float all = counts[i - 1] + counts[i] + counts[i + 1];
    const float sum = costs[i - 1] + costs[i] + costs[i + 1];
    mean[i] = all >= least ? sum / all : std::numeric_limits<float>::infinity();
  }
}

PLENOCAL_FOR_EACH_PROCESSOR
void AddEquations(const DepthPixels& pixels, const OtherPatch& patch, const DepthEquations& sums) {
  const OtherPatch other =
      patch;  // copies, so that the compiler sees that the sums do not change them
  const int pixel_count = pixels.count;
  // Cauchy's weight over the variance, 1 / (variance + e^2 / width^2): one division gives both.
  constexpr float kInverseScale = 1 / kCauchyWidthSquared<float>;
  const float inverse_length =
      1 / (other.baseline_x * other.baseline_x + other.baseline_y * other.baseline_y);
  const float* __restrict x = pixels.x;
  const float* __restrict y = pixels.y;
  const float* __restrict z = pixels.z;
  const float* __restrict values = pixels.value;
  const float* __restrict gradient_x = pixels.gradient_x;
  const float* __restrict gradient_y = pixels.gradient_y;
  const float* __restrict laplacians = pixels.laplacian;
  const float* __restrict variances = pixels.variance;
  const float* __restrict others = other.value;
  float* __restrict gradient = sums.gradient;
  float* __restrict information = sums.information;
  float* __restrict agreement = sums.agreement;
  float* __restrict count = sums.count;
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

}  // namespace plenocal::internal
