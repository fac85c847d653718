// SPDX-License-Identifier: Apache-2.0
#include "detectors/apriltag/least_contrast.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <vector>

namespace plenocal::internal {
namespace {

constexpr int kBlock = 32;  // px

/// Sigma of the noise in a block without texture, grey values, from the second differences along
/// its rows; none where a tenth of the block is clipped.
std::optional<double> BlockNoise(const cv::Mat& block) {
  // What a median of absolute values is of sigma, and sigma of the second difference of white
  // noise.
  constexpr double kMedian = 0.6745, kSecondDifference = 2.4495;
  std::array<int, 2 * 255 + 1> counts{};
  int count = 0, clipped = 0;
  for (int y = 0; y < block.rows; y += 2) {
    const auto* row = block.ptr<std::uint8_t>(y);
    for (int x = 1; x + 1 < block.cols; ++x) {
      ++counts[static_cast<std::size_t>(std::abs(row[x - 1] - 2 * row[x] + row[x + 1]))];
      ++count;
      clipped += row[x] == 0 || row[x] == 255 ? 1 : 0;
    }
  }
  if (10 * clipped > count) return {};
  // Interpolated: values are whole numbers.
  int below = 0;
  std::size_t median = 0;
  while (2 * (below + counts[median]) < count) below += counts[median++];
  const double part = (0.5 * count - below) / counts[median];
  return std::max(0.0, static_cast<double>(median) - 0.5 + part) / (kMedian * kSecondDifference);
}

}  // namespace

int LeastContrast(const cv::Mat& gray) {
  // The library compares the range of 12 x 12 pixels. That of normal noise is above 6 sigma in one
  // window out of nine; where a tag's outline crosses the window, the tag's contrast is added.
  constexpr double kRange = 6;
  constexpr int kLibrary = 5;
  std::vector<double> noise;
  for (int y = 0; y + kBlock <= gray.rows; y += kBlock) {
    for (int x = 0; x + kBlock <= gray.cols; x += kBlock) {
      if (const auto sigma = BlockNoise(gray({x, y, kBlock, kBlock}))) noise.push_back(*sigma);
    }
  }
  if (noise.empty()) return kLibrary;
  // Of the smoothest tenth: texture is no noise, and shadows, where tags have little contrast,
  // have less noise than bright parts.
  const auto smooth = noise.begin() + static_cast<std::ptrdiff_t>(noise.size() / 10);
  std::nth_element(noise.begin(), smooth, noise.end());
  return std::max(kLibrary, static_cast<int>(std::lround(kRange * *smooth)));
}

}  // namespace plenocal::internal
