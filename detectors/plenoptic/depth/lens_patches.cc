// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/lens_patches.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "calib/base/parallel.h"
#include "calib/kernels/processors.h"

namespace plenocal::internal {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
/// Floats after the last patch: blocks of eight may read beyond its last row.
constexpr size_t kTail = 16;
constexpr size_t kLensesPerTask = 64;
/// A pixel belongs to its micro image from this part of the highest attenuation on: half is where
/// the edge of a blurred disc lies.
constexpr float kEdgeAttenuation = 0.5f;

/// The filter (1, -2, 1) in both directions: sum of its squared coefficients, and sum of the
/// squares of a one-dimensional pass' autocorrelation (1, -4, 6, -4, 1).
constexpr double kFilterPower = 36, kFilterCorrelation = 70;

/// Replaces a patch by means of 3 x 3 values that all belong to the micro image; the others become
/// NaN. `origin`: raw pixel of the patch's first value.
void SmoothPatch(int size,
                 const Eigen::Vector2i& origin,
                 const MosaicWeights& mosaic,
                 float* value) {
  std::vector<float> mean(static_cast<size_t>(size) * size, kNan);
  for (int y = 1; y + 1 < size; ++y) {
    // Weights in this row and in those beside it; origins may be negative.
    const float* own = mosaic.data() + 2 * ((origin.y() + y) & 1);
    const float* beside = mosaic.data() + 2 * ((origin.y() + y + 1) & 1);
    for (int x = 1; x + 1 < size; ++x) {
      const float* v = value + static_cast<size_t>(y) * size + x;
      const int here = (origin.x() + x) & 1, next = 1 - here;
      // Pixels of weight 0 must be known as well: NaN times 0 is NaN.
      const auto row = [&](const float* r, const float* weights) {
        return weights[next] * (r[-1] + r[1]) + 2 * weights[here] * r[0];
      };
      mean[static_cast<size_t>(y) * size + x] =
          (row(v - size, beside) + 2 * row(v, own) + row(v + size, beside)) / 4;
    }
  }
  std::copy(mean.begin(), mean.end(), value);
}

/// Copies one micro image out of the raw image. REQUIRES: `patches` has the lens' origin and NaN
/// values.
void CutPatch(const cv::Mat& raw,
              const MicroLens& lens,
              size_t index,
              const std::optional<MosaicWeights>& mosaic,
              LensPatches* patches) {
  const cv::Mat& attenuation = patches->attenuation;
  const int size = patches->size, half = size / 2 - LensPatches::kMargin;
  const Eigen::Vector2i origin = patches->origin[index], middle = origin.array() + size / 2;
  const float radius = patches->radius_px;
  // Calls use(raw, attenuation, value, count) for the pixels of each row within the radius.
  const auto for_each_row = [&](auto&& use) {
    const int top = std::max(0, middle.y() - half);
    const int bottom = std::min(raw.rows - 1, middle.y() + half);
    for (int y = top; y <= bottom; ++y) {
      const float dy = static_cast<float>(y - lens.centre.y());
      if (dy * dy > radius * radius) continue;
      const double reach = std::sqrt(radius * radius - dy * dy);
      const int left = std::max(0, static_cast<int>(std::ceil(lens.centre.x() - reach)));
      const int right =
          std::min(raw.cols - 1, static_cast<int>(std::floor(lens.centre.x() + reach)));
      use(raw.ptr<float>(y) + left,
          attenuation.ptr<float>(y) + left,
          patches->value.data() + index * patches->Area() +
              static_cast<size_t>(y - origin.y()) * size + left - origin.x(),
          right - left + 1);
    }
  };
  float highest = 0;
  for_each_row([&](const float*, const float* v, const float*, int count) {
    for (int i = 0; i < count; ++i) highest = std::max(highest, v[i]);
  });
  if (!(highest > 0)) return;
  for_each_row([&](const float* __restrict grey,
                   const float* __restrict v,
                   float* __restrict value,
                   int count) {
    for (int i = 0; i < count; ++i) {
      const float exact = grey[i] / v[i];
      value[i] = v[i] >= highest * kEdgeAttenuation ? exact : kNan;
    }
  });
  if (mosaic) SmoothPatch(size, origin, *mosaic, patches->value.data() + index * patches->Area());
}

struct Smoothness {
  float level = 0;     // mean raw value
  float variance = 0;  // noise variance if the micro image has no texture
  int pixels = 0;
};

/// Sums over the pixels of a column.
struct ColumnSums {
  std::vector<float> level, squares, pixels;
};

/// Adds a row of `count` pixels to their columns. Rows of `value` are `stride` floats apart.
PLENOCAL_FOR_EACH_PROCESSOR
void AddSmoothness(
    const float* value, const float* attenuation, int stride, int count, ColumnSums* sums) {
  float* __restrict level = sums->level.data();
  float* __restrict squares = sums->squares.data();
  float* __restrict pixels = sums->pixels.data();
  const auto second = [](const float* r) { return r[-1] - 2 * r[0] + r[1]; };
  for (int i = 0; i < count; ++i) {
    const float* v = value + i;
    const float h = second(v - stride) - 2 * second(v) + second(v + stride);
    const bool known = h == h;
    const float raw_h = h * attenuation[i];
    level[i] += known ? v[0] * attenuation[i] : 0;
    squares[i] += known ? raw_h * raw_h : 0;
    pixels[i] += known ? 1.f : 0.f;
  }
}

Smoothness MeasureSmoothness(const LensPatches& patches, size_t lens, ColumnSums* sums) {
  const PatchBox box = patches.Inside(lens, 0);
  for (auto* sum : {&sums->level, &sums->squares, &sums->pixels}) sum->assign(patches.size, 0.f);
  for (int y = box.top; y < box.bottom; ++y) {
    AddSmoothness(patches.Value(lens) + static_cast<size_t>(y) * patches.size + box.left,
                  patches.attenuation.ptr<float>(patches.origin[lens].y() + y) +
                      patches.origin[lens].x() + box.left,
                  patches.size,
                  box.right - box.left,
                  sums);
  }
  const auto all = [](const std::vector<float>& sum) {
    return std::accumulate(sum.begin(), sum.end(), 0.0);
  };
  const double pixels = all(sums->pixels);
  if (pixels == 0) return {};
  return {static_cast<float>(all(sums->level) / pixels),
          static_cast<float>(all(sums->squares) / kFilterPower / pixels),
          static_cast<int>(pixels)};
}

/// Noise variance of micro images of about one brightness: from the tenth smoothest of a hundred,
/// as texture adds to the others. A mean of n squares that overlap has the relative variance 2 / n
/// times (70 / 36)^2, the sum of the filter's squared correlations; the quantile is corrected to
/// the mean.
struct BrightnessBin {
  float level;
  double variance;

  BrightnessBin(std::vector<Smoothness>::iterator begin, std::vector<Smoothness>::iterator end) {
    constexpr double kTenthQuantile = 1.2816;  // standard deviations below a normal mean
    constexpr double kLeastRatio = 0.1;  // of quantile and mean, where few pixels give no estimate
    const auto tenth = begin + (end - begin) / 10;
    std::nth_element(begin, tenth, end, [](const Smoothness& a, const Smoothness& c) {
      return a.variance < c.variance;
    });
    const double scatter = std::sqrt(2.0 / tenth->pixels) * kFilterCorrelation / kFilterPower;
    level = tenth->level;
    variance = tenth->variance / std::max(kLeastRatio, 1 - kTenthQuantile * scatter);
  }
};

/// The line variance = read + shot * level through the bins, neither of them negative.
SensorNoise FitNoiseLine(const std::vector<BrightnessBin>& bins) {
  constexpr double kNoZero =
      1e-12;  // grey values^4: keeps the weight of a bin without noise finite
  constexpr double kOneLevel = 1e-9;  // relative determinant of bins that are of one brightness
  double s = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (const BrightnessBin& bin : bins) {
    // Relative errors are alike, so each bin weighs by its inverse square.
    const double w = 1 / (bin.variance * bin.variance + kNoZero), x = bin.level;
    s += w, sx += w * x, sy += w * bin.variance, sxx += w * x * x, sxy += w * x * bin.variance;
  }
  const double determinant = s * sxx - sx * sx;
  double shot = determinant > kOneLevel * s * sxx ? (s * sxy - sx * sy) / determinant : 0;
  shot = std::max(0.0, shot);
  double read = (sy - shot * sx) / s;
  if (read < 0) {
    read = 0;
    shot = sxx > 0 ? sxy / sxx : 0;
  }
  return {static_cast<float>(read), static_cast<float>(shot)};
}

}  // namespace

PatchBox LensPatches::Inside(size_t lens, int border) const {
  const Eigen::Vector2i& first = origin[lens];
  return {.left = std::max(kMargin, border - first.x()),
          .right = std::min(size - kMargin, attenuation.cols - border - first.x()),
          .top = std::max(kMargin, border - first.y()),
          .bottom = std::min(size - kMargin, attenuation.rows - border - first.y())};
}

float LensPatches::HighestAttenuation(size_t lens) const {
  const float* known = Value(lens);
  float highest = 0;
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      if (!std::isnan(known[y * size + x])) highest = std::max(highest, Attenuation(lens, x, y));
    }
  }
  return highest;
}

Eigen::Vector2f LensPatches::LogAttenuationGradient(size_t lens, int x, int y) const {
  const cv::Mat& v = attenuation;
  const int column = origin[lens].x() + x, row = origin[lens].y() + y;
  if (column < 1 || row < 1 || column + 1 >= v.cols || row + 1 >= v.rows) return {0, 0};
  const float* at = v.ptr<float>(row) + column;
  const float above = v.ptr<float>(row - 1)[column], below = v.ptr<float>(row + 1)[column];
  // The half difference of ln V as (V+ - V-) / (V+ + V-), whose two pixels have one colour in a
  // mosaic.
  return {(at[1] - at[-1]) / (at[1] + at[-1]), (below - above) / (below + above)};
}

LensPatches CutPatches(const cv::Mat& raw,
                       const cv::Mat& attenuation,
                       const MicroLensArray& array,
                       const std::optional<MosaicWeights>& mosaic,
                       int threads) {
  LensPatches patches;
  const double limit = array.Pitch() / 2 - 0.5;
  patches.radius_px = static_cast<float>(limit);
  patches.filter_radius = mosaic ? 1 : 0;
  patches.size = 2 * (static_cast<int>(std::ceil(limit)) + LensPatches::kMargin) + 1;
  const size_t lenses = array.lenses.size();
  patches.value.assign(lenses * patches.Area() + kTail, kNan);
  patches.attenuation = attenuation;
  patches.origin.resize(lenses);
  patches.centre.resize(lenses);
  ParallelFor((lenses + kLensesPerTask - 1) / kLensesPerTask, threads, [&](size_t task) {
    const size_t end = std::min(lenses, (task + 1) * kLensesPerTask);
    for (size_t l = task * kLensesPerTask; l < end; ++l) {
      const MicroLens& lens = array.lenses[l];
      const Eigen::Vector2i middle(static_cast<int>(std::lround(lens.centre.x())),
                                   static_cast<int>(std::lround(lens.centre.y())));
      patches.origin[l] = middle.array() - patches.size / 2;
      patches.centre[l] = (lens.centre - patches.origin[l].cast<double>()).cast<float>();
      if (lens.usable) CutPatch(raw, lens, l, mosaic, &patches);
    }
  });
  return patches;
}

SensorNoise EstimateNoise(const LensPatches& patches) {
  // Bins of brightness, and micro images that a bin needs for its tenth smoothest.
  constexpr size_t kBins = 8, kFewest = 10;
  constexpr float kRounding = 1.f / 12;  // variance of rounding to whole grey values
  std::vector<Smoothness> all;
  ColumnSums sums;
  for (size_t l = 0; l < patches.origin.size(); ++l) {
    const Smoothness one = MeasureSmoothness(patches, l, &sums);
    if (one.pixels > 0) all.push_back(one);
  }
  if (all.size() < kFewest) return {kRounding, 0};
  std::sort(all.begin(), all.end(), [](const Smoothness& a, const Smoothness& b) {
    return a.level < b.level;
  });
  const size_t count = std::min(kBins, all.size() / kFewest);
  std::vector<BrightnessBin> bins;
  for (size_t b = 0; b < count; ++b) {
    bins.emplace_back(all.begin() + b * all.size() / count,
                      all.begin() + (b + 1) * all.size() / count);
  }
  const SensorNoise noise = FitNoiseLine(bins);
  return {std::max(kRounding, noise.read), noise.shot};
}

}  // namespace plenocal::internal
