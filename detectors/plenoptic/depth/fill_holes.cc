// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/fill_holes.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace plenocal::internal {
namespace {

struct LevelRow {
  float *value, *variance, *weight, *reach;
};

/// One level of the pyramid. The value is unknown where `weight` is 0.
struct Level {
  cv::Mat value, variance, weight, reach;

  Level(int rows, int columns)
      : value(cv::Mat::zeros(rows, columns, CV_32F)),
        variance(value.clone()),
        weight(value.clone()),
        reach(value.clone()) {}
  [[nodiscard]] LevelRow Row(int y) {
    return {value.ptr<float>(y), variance.ptr<float>(y), weight.ptr<float>(y), reach.ptr<float>(y)};
  }
};

/// Means over 2 x 2 pixels, weighted by the known part of each.
Level Coarser(Level* fine) {
  const int rows = fine->value.rows, columns = fine->value.cols;
  Level coarse((rows + 1) / 2, (columns + 1) / 2);
  for (int y = 0; y < coarse.value.rows; ++y) {
    const LevelRow row = coarse.Row(y), upper = fine->Row(2 * y);
    const LevelRow lower = fine->Row(std::min(2 * y + 1, rows - 1));
    const bool has_lower = 2 * y + 1 < rows;
    for (int x = 0; x < coarse.value.cols; ++x) {
      float weight = 0, sum = 0, square = 0, variance = 0;
      const auto add = [&](const LevelRow& from) {
        for (int at = 2 * x; at < std::min(2 * x + 2, columns); ++at) {
          const float w = from.weight[at], v = from.value[at];
          weight += w;
          sum += w * v;
          square += w * v * v;
          variance += w * from.variance[at];
        }
      };
      add(upper);
      if (has_lower) add(lower);
      if (weight <= 0) continue;
      const float mean = sum / weight;
      row.value[x] = mean;
      row.variance[x] = variance / weight + std::max(0.f, square / weight - mean * mean);
      row.weight[x] = weight / 4;
    }
  }
  return coarse;
}

/// Interpolates the unknown pixels of `fine` linearly in `coarse`, which has no unknown pixels.
void FillFrom(Level* coarse, float reach, Level* fine) {
  const int last_row = coarse->value.rows - 1, last_column = coarse->value.cols - 1;
  for (int y = 0; y < fine->value.rows; ++y) {
    const float v =
        std::clamp((static_cast<float>(y) - 0.5f) / 2, 0.f, static_cast<float>(last_row));
    const int y0 = static_cast<int>(v);
    const float fy = v - static_cast<float>(y0);
    const LevelRow row = fine->Row(y), upper = coarse->Row(y0),
                   lower = coarse->Row(std::min(y0 + 1, last_row));
    for (int x = 0; x < fine->value.cols; ++x) {
      if (row.weight[x] > 0) continue;
      const float u =
          std::clamp((static_cast<float>(x) - 0.5f) / 2, 0.f, static_cast<float>(last_column));
      const int x0 = static_cast<int>(u), x1 = std::min(x0 + 1, last_column);
      const float fx = u - static_cast<float>(x0);
      const auto between = [&](auto&& of) {
        return (1 - fy) * ((1 - fx) * of(upper, x0) + fx * of(upper, x1)) +
               fy * ((1 - fx) * of(lower, x0) + fx * of(lower, x1));
      };
      const float mean = between([](const LevelRow& r, int at) { return r.value[at]; });
      const float square =
          between([](const LevelRow& r, int at) { return r.value[at] * r.value[at]; });
      const float variance = between([](const LevelRow& r, int at) { return r.variance[at]; });
      row.value[x] = mean;
      row.variance[x] = variance + std::max(0.f, square - mean * mean);
      row.reach[x] =
          std::max(reach, between([](const LevelRow& r, int at) { return r.reach[at]; }));
    }
  }
}

}  // namespace

Filled FillHoles(const cv::Mat& value, const cv::Mat& variance) {
  std::vector<Level> levels;
  levels.emplace_back(value.rows, value.cols);
  bool anything = false;
  for (int y = 0; y < value.rows; ++y) {
    const LevelRow row = levels[0].Row(y);
    const auto *value_row = value.ptr<float>(y), *variance_row = variance.ptr<float>(y);
    for (int x = 0; x < value.cols; ++x) {
      if (std::isnan(value_row[x])) continue;
      anything = true;
      row.value[x] = value_row[x];
      row.variance[x] = variance_row[x];
      row.weight[x] = 1;
    }
  }
  if (!anything) return {value.clone(), variance.clone(), levels[0].reach};
  while (levels.back().value.total() > 1) levels.push_back(Coarser(&levels.back()));
  for (size_t l = levels.size() - 1; l-- > 0;) {
    FillFrom(&levels[l + 1], static_cast<float>(std::ldexp(2.0, static_cast<int>(l))), &levels[l]);
  }
  return {levels[0].value, levels[0].variance, levels[0].reach};
}

}  // namespace plenocal::internal
