// SPDX-License-Identifier: Apache-2.0
#include "detectors/lens_patches.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/parallel.h"

namespace plenocal::internal {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
/// Floats after the last patch: blocks of eight may read beyond its last row.
constexpr size_t kTail = 16;
constexpr size_t kLensesPerTask = 64;

/// Means of 3 x 3 values that all belong to the micro image; elsewhere nothing is left. `origin`:
/// raw pixel of the first.
void SmoothPatch(int size,
                 const Eigen::Vector2i& origin,
                 const MosaicWeights& mosaic,
                 float* value) {
  std::vector<float> mean(static_cast<size_t>(size) * size, kNan);
  for (int y = 1; y + 1 < size; ++y) {
    // Of this row and of those beside it; origins may be negative.
    const float* own = mosaic.data() + 2 * ((origin.y() + y) & 1);
    const float* beside = mosaic.data() + 2 * ((origin.y() + y + 1) & 1);
    for (int x = 1; x + 1 < size; ++x) {
      const float* v = value + static_cast<size_t>(y) * size + x;
      const int here = (origin.x() + x) & 1, next = 1 - here;
      // Also what does not count must be known: NaN times 0 is NaN.
      const auto row = [&](const float* r, const float* weights) {
        return weights[next] * (r[-1] + r[1]) + 2 * weights[here] * r[0];
      };
      mean[static_cast<size_t>(y) * size + x] =
          (row(v - size, beside) + 2 * row(v, own) + row(v + size, beside)) / 4;
    }
  }
  std::copy(mean.begin(), mean.end(), value);
}

struct Smoothness {
  float level = 0;     // mean raw value
  float variance = 0;  // noise variance if the micro image has no texture
  int pixels = 0;
};

Smoothness Measure(const LensPatches& patches, size_t lens) {
  const int n = patches.size;
  const float* value = patches.Value(lens);
  double level = 0, squares = 0;
  int pixels = 0;
  for (int y = 1; y + 1 < n; ++y) {
    for (int x = 1; x + 1 < n; ++x) {
      const float* v = value + static_cast<size_t>(y) * n + x;
      const auto second = [](const float* r) { return r[-1] - 2 * r[0] + r[1]; };
      const float h = second(v - n) - 2 * second(v) + second(v + n);
      if (std::isnan(h)) continue;
      const float attenuation = patches.Light(lens, x, y);
      level += v[0] * attenuation;
      squares += static_cast<double>(h) * h * attenuation * attenuation / 36;
      ++pixels;
    }
  }
  if (pixels == 0) return {};
  return {static_cast<float>(level / pixels), static_cast<float>(squares / pixels), pixels};
}

}  // namespace

float LensPatches::BrightestLight(size_t lens) const {
  const float* known = Value(lens);
  float brightest = 0;
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      if (!std::isnan(known[y * size + x])) brightest = std::max(brightest, Light(lens, x, y));
    }
  }
  return brightest;
}

Eigen::Vector2f LensPatches::LightSlope(size_t lens, int x, int y) const {
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
  const int reach = static_cast<int>(std::ceil(limit));
  patches.radius_px = static_cast<float>(limit);
  patches.reach = mosaic ? 1 : 0;
  patches.size = 2 * (reach + LensPatches::kMargin) + 1;
  const size_t lenses = array.lenses.size(), area = patches.Area();
  patches.value.assign(lenses * area + kTail, kNan);
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
      if (!lens.usable) continue;
      float* value = patches.value.data() + l * area;
      float brightest = 0;
      const auto visit = [&](auto&& use) {
        for (int y = std::max(0, middle.y() - reach);
             y <= std::min(raw.rows - 1, middle.y() + reach);
             ++y) {
          const float dy = static_cast<float>(y - lens.centre.y());
          const auto* raw_row = raw.ptr<float>(y);
          const auto* light_row = attenuation.ptr<float>(y);
          const size_t at = static_cast<size_t>(y - patches.origin[l].y()) * patches.size;
          for (int x = std::max(0, middle.x() - reach);
               x <= std::min(raw.cols - 1, middle.x() + reach);
               ++x) {
            const float dx = static_cast<float>(x - lens.centre.x());
            if (dx * dx + dy * dy > patches.radius_px * patches.radius_px) continue;
            use(raw_row[x], light_row[x], at + x - patches.origin[l].x());
          }
        }
      };
      visit([&](float, float v, size_t) { brightest = std::max(brightest, v); });
      if (!(brightest > 0)) continue;
      visit([&](float i, float v, size_t at) {
        if (v >= brightest / 2) value[at] = i / v;
      });
      if (mosaic) SmoothPatch(patches.size, patches.origin[l], *mosaic, value);
    }
  });
  return patches;
}

SensorNoise EstimateNoise(const LensPatches& patches) {
  constexpr size_t kBins = 8, kFewest = 10;
  constexpr float kRounding = 1.f / 12;
  std::vector<Smoothness> all;
  for (size_t l = 0; l < patches.origin.size(); ++l) {
    const Smoothness one = Measure(patches, l);
    if (one.pixels > 0) all.push_back(one);
  }
  if (all.size() < kFewest) return {kRounding, 0};
  std::sort(all.begin(), all.end(), [](const Smoothness& a, const Smoothness& b) {
    return a.level < b.level;
  });
  // In each bin of brightness the tenth smoothest of a hundred. A mean of n squares that overlap
  // (variance of the mean 2 / n times the sum of the squared correlations of the filter, (70 /
  // 36)^2) scatters, so its quantile is corrected to the mean.
  const size_t bins = std::min(kBins, all.size() / kFewest);
  double s = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  float lowest = std::numeric_limits<float>::infinity();
  for (size_t b = 0; b < bins; ++b) {
    const auto begin = all.begin() + b * all.size() / bins,
               end = all.begin() + (b + 1) * all.size() / bins;
    const auto tenth = begin + (end - begin) / 10;
    std::nth_element(begin, tenth, end, [](const Smoothness& a, const Smoothness& c) {
      return a.variance < c.variance;
    });
    const double scatter = std::sqrt(2.0 / tenth->pixels) * 70 / 36;
    const double variance = tenth->variance / std::max(0.1, 1 - 1.2816 * scatter);
    // Relative errors are alike, so each bin weighs by its inverse square.
    const double w = 1 / (variance * variance + 1e-12), x = tenth->level;
    s += w, sx += w * x, sy += w * variance, sxx += w * x * x, sxy += w * x * variance;
    lowest = std::min(lowest, static_cast<float>(variance));
  }
  const double determinant = s * sxx - sx * sx;
  double shot = determinant > 1e-9 * s * sxx ? (s * sxy - sx * sy) / determinant : 0;
  shot = std::max(0.0, shot);
  double read = (sy - shot * sx) / s;
  if (read < 0) {
    read = 0;
    shot = sxx > 0 ? sxy / sxx : 0;
  }
  return {std::max(kRounding, static_cast<float>(read)), static_cast<float>(shot)};
}

}  // namespace plenocal::internal
