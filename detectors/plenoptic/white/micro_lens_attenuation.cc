// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/micro_lens_attenuation.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/core.hpp>
#include <utility>

#include "detectors/images/attenuation.h"

namespace plenocal {

using internal::ForBayerPlanes;
using internal::LimitAttenuation;

namespace {

/// Highest value of the smooth envelope of the micro images: the running maximum of their
/// brightness, over three neighbours at a time, smoothed with a Gaussian of one pitch. Made of
/// fitted brightnesses, as a running maximum of pixels would be raised by their noise.
double HighestOfEnvelope(const MicroLensGrid& grid) {
  std::map<std::pair<int, int>, double> gains, maxima;
  for (size_t i = 0; i < grid.gains.size(); ++i) {
    const MicroLens& lens = grid.array.lenses[i];
    if (lens.usable) gains[{lens.column, lens.row}] = grid.gains[i];
  }
  for (const auto& [node, gain] : gains) {
    const auto right = gains.find({node.first + 1, node.second});
    const auto below = gains.find({node.first, node.second + 1});
    if (right == gains.end() || below == gains.end()) continue;
    maxima[node] = std::max({gain, right->second, below->second});
  }
  constexpr int kReach = 3;
  double highest = 0;
  for (const auto& [node, maximum] : maxima) {
    double sum = 0, weights = 0;
    for (int row = -kReach; row <= kReach; ++row) {
      for (int column = -kReach; column <= kReach; ++column) {
        const auto near = maxima.find({node.first + column, node.second + row});
        if (near == maxima.end()) continue;
        // Squared distance in pitches, of vectors 60 degrees apart.
        const double weight = std::exp(-0.5 * (column * column + column * row + row * row));
        sum += weight * near->second;
        weights += weight;
      }
    }
    highest = std::max(highest, sum / weights);
  }
  return highest;
}

}  // namespace

cv::Mat MicroLensAttenuation(const cv::Mat& white,
                             const MicroLensGrid& grid,
                             std::optional<BayerOrder> bayer) {
  const double highest = HighestOfEnvelope(grid);
  if (!bayer) return LimitAttenuation(white / highest);
  // The grid's gains hold for planes at the level of the whole mosaic.
  const double level = cv::mean(white)[0];
  return LimitAttenuation(ForBayerPlanes(white, [&](const cv::Mat& plane) {
    return cv::Mat(plane * (level / cv::mean(plane)[0] / highest));
  }));
}

cv::Mat LevelBayerPlanes(const cv::Mat& mosaic) {
  const cv::Mat level = LargeScaleMean(mosaic);
  const cv::Mat ratio = ForBayerPlanes(
      mosaic, [](const cv::Mat& plane) { return cv::Mat(plane / LargeScaleMean(plane)); });
  return ratio.mul(level);
}

}  // namespace plenocal
