// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/fill_holes.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace plenocal::internal {
namespace {

/// One level of the pyramid. The value is unknown where `weight` is 0.
struct Level {
  cv::Mat value, variance, weight, reach;
};

Level MakeLevel(int rows, int columns) {
  const auto zero = [&] { return cv::Mat(cv::Mat::zeros(rows, columns, CV_32F)); };
  return {zero(), zero(), zero(), zero()};
}

/// Means over 2 x 2 pixels, weighted by the known part of each.
Level Coarser(const Level& fine) {
  Level coarse = MakeLevel((fine.value.rows + 1) / 2, (fine.value.cols + 1) / 2);
  for (int y = 0; y < coarse.value.rows; ++y) {
    for (int x = 0; x < coarse.value.cols; ++x) {
      float weight = 0, sum = 0, square = 0, variance = 0;
      for (int k = 0; k < 4; ++k) {
        const int fy = 2 * y + k / 2, fx = 2 * x + k % 2;
        if (fy >= fine.value.rows || fx >= fine.value.cols) continue;
        const float w = fine.weight.at<float>(fy, fx), v = fine.value.at<float>(fy, fx);
        weight += w;
        sum += w * v;
        square += w * v * v;
        variance += w * fine.variance.at<float>(fy, fx);
      }
      if (weight <= 0) continue;
      const float mean = sum / weight;
      coarse.value.at<float>(y, x) = mean;
      coarse.variance.at<float>(y, x) =
          variance / weight + std::max(0.f, square / weight - mean * mean);
      coarse.weight.at<float>(y, x) = weight / 4;
    }
  }
  return coarse;
}

/// Interpolates the unknown pixels of `fine` linearly in `coarse`, which has no unknown pixels.
void FillFrom(const Level& coarse, float reach, Level* fine) {
  const cv::Mat square = coarse.value.mul(coarse.value);
  for (int y = 0; y < fine->value.rows; ++y) {
    for (int x = 0; x < fine->value.cols; ++x) {
      if (fine->weight.at<float>(y, x) > 0) continue;
      const float u = std::clamp(
          (static_cast<float>(x) - 0.5f) / 2, 0.f, static_cast<float>(coarse.value.cols - 1));
      const float v = std::clamp(
          (static_cast<float>(y) - 0.5f) / 2, 0.f, static_cast<float>(coarse.value.rows - 1));
      const int x0 = static_cast<int>(u), y0 = static_cast<int>(v);
      const int x1 = std::min(x0 + 1, coarse.value.cols - 1);
      const int y1 = std::min(y0 + 1, coarse.value.rows - 1);
      const float fx = u - static_cast<float>(x0), fy = v - static_cast<float>(y0);
      const auto between = [&](const cv::Mat& m) {
        const auto *upper = m.ptr<float>(y0), *lower = m.ptr<float>(y1);
        return (1 - fy) * ((1 - fx) * upper[x0] + fx * upper[x1]) +
               fy * ((1 - fx) * lower[x0] + fx * lower[x1]);
      };
      const float mean = between(coarse.value);
      const float spread = std::max(0.f, between(square) - mean * mean);
      fine->value.at<float>(y, x) = mean;
      fine->variance.at<float>(y, x) = between(coarse.variance) + spread;
      fine->reach.at<float>(y, x) = std::max(reach, between(coarse.reach));
    }
  }
}

}  // namespace

Filled FillHoles(const cv::Mat& value, const cv::Mat& variance) {
  std::vector<Level> levels;
  levels.push_back(MakeLevel(value.rows, value.cols));
  bool anything = false;
  for (int y = 0; y < value.rows; ++y) {
    for (int x = 0; x < value.cols; ++x) {
      if (std::isnan(value.at<float>(y, x))) continue;
      anything = true;
      levels[0].value.at<float>(y, x) = value.at<float>(y, x);
      levels[0].variance.at<float>(y, x) = variance.at<float>(y, x);
      levels[0].weight.at<float>(y, x) = 1;
    }
  }
  if (!anything) return {value.clone(), variance.clone(), levels[0].reach};
  while (levels.back().value.total() > 1) levels.push_back(Coarser(levels.back()));
  for (size_t l = levels.size() - 1; l-- > 0;) {
    FillFrom(levels[l + 1], static_cast<float>(std::ldexp(2.0, static_cast<int>(l))), &levels[l]);
  }
  return {levels[0].value, levels[0].variance, levels[0].reach};
}

}  // namespace plenocal::internal
