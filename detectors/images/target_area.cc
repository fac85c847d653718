// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/target_area.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace plenocal::internal {
namespace {

/// Numbers of pixels by gray level.
using GrayCounts = std::array<double, 256>;

int QuantileOf(const GrayCounts& counts, double part) {
  const double all = std::accumulate(counts.begin(), counts.end(), 0.0);
  double below = 0;
  for (int level = 0; level < 256; ++level) {
    below += counts[static_cast<size_t>(level)];
    if (below > part * all) return level;
  }
  return 255;
}

GrayCounts CountGray(const cv::Mat& gray, const cv::Mat& inside) {
  // In turns: a count that follows one of the same level would wait until that is stored.
  constexpr int kTurns = 4;
  std::array<std::array<int, 256>, kTurns> parts{};
  for (int y = 0; y < gray.rows; ++y) {
    const auto *level = gray.ptr<uchar>(y), *is_inside = inside.ptr<uchar>(y);
    for (int x = 0; x < gray.cols; ++x) parts[x % kTurns][level[x]] += is_inside[x];
  }
  GrayCounts counts{};
  for (const auto& part : parts) {
    for (size_t level = 0; level < counts.size(); ++level) counts[level] += part[level];
  }
  return counts;
}

/// Gradients of one direction of edges.
struct GradientSums {
  double lengths = 0, squares = 0;
};
using EdgeDirections = std::array<GradientSums, 4>;  // multiples of 45 degrees

/// The multiple of 45 degrees that a gradient's line is nearest to.
size_t DirectionOf(double dx, double dy) {
  constexpr double kTan = M_SQRT2 - 1;  // of 22.5 degrees
  const double across = std::abs(dx), down = std::abs(dy);
  if (down <= kTan * across) return 0;
  if (across <= kTan * down) return 2;
  return (dx > 0) == (dy > 0) ? 1 : 3;
}

/// Sums of the gradients of `smooth` (CV_32FC1) that are longer than `least`, gray levels a pixel.
EdgeDirections SumGradients(const cv::Mat& smooth, const cv::Mat& inside, double least) {
  EdgeDirections sums{};
  constexpr double kRounding = 1e-3;
  const auto limit = static_cast<float>((1 - kRounding) * least * least);
  std::vector<int> steep(smooth.cols);
  for (int y = 1; y + 1 < smooth.rows; ++y) {
    const auto *above = smooth.ptr<float>(y - 1), *row = smooth.ptr<float>(y),
               *below = smooth.ptr<float>(y + 1);
    const auto* is_inside = inside.ptr<uchar>(y);
    // Collected first and without a branch; few are steep.
    int count = 0;
    for (int x = 1; x + 1 < smooth.cols; ++x) {
      const float dx = (row[x + 1] - row[x - 1]) / 2, dy = (below[x] - above[x]) / 2;
      steep[count] = x;
      count += static_cast<int>(is_inside[x] != 0) & static_cast<int>(dx * dx + dy * dy > limit);
    }
    for (int i = 0; i < count; ++i) {
      const int x = steep[i];
      const double dx = (row[x + 1] - row[x - 1]) / 2;
      const double dy = (below[x] - above[x]) / 2;
      const double square = dx * dx + dy * dy;
      if (square < least * least) continue;
      GradientSums& sum = sums[DirectionOf(dx, dy)];
      sum.lengths += std::sqrt(square);
      sum.squares += square;
    }
  }
  return sums;
}

/// A step of height a, blurred by a Gaussian of width s, has gradients whose integrals across the
/// edge are a, and a^2 / (2 sqrt(pi) s) of the squares.
double BlurOf(const EdgeDirections& sums, double step) {
  double total = 0, widest = 0;
  for (const GradientSums& sum : sums) total += sum.lengths;
  for (const GradientSums& sum : sums) {
    // Directions with less than half of an even share are corners and noise.
    if (sum.squares == 0 || sum.lengths < total / (2.0 * sums.size())) continue;
    widest = std::max(widest, step * sum.lengths / (2 * std::sqrt(M_PI) * sum.squares));
  }
  return widest;
}

double MeasureBlur(const cv::Mat& gray, const cv::Mat& inside, const GrayCounts& counts) {
  // Gradients of noise of sigma n, smoothed by a Gaussian of 1 px, have a sigma of n / sqrt(8 pi):
  // 0.2 n. Noise of real images is below 5 levels, else their edges are too weak for markers.
  constexpr double kSmooth = 1, kNoiseGradient = 3;
  cv::Mat smooth;
  gray.convertTo(smooth, CV_32F);
  cv::GaussianBlur(smooth, smooth, {}, kSmooth);
  const double step = QuantileOf(counts, 0.95) - QuantileOf(counts, 0.05);
  const double width = BlurOf(SumGradients(smooth, inside, kNoiseGradient), step);
  if (width == 0) return 0;
  // Without the smoothing and the width of the difference, whose variance is 1/3.
  constexpr double kOwn = kSmooth * kSmooth + 1.0 / 3, kSharpest = 0.5;
  return std::sqrt(std::max(width * width - kOwn, kSharpest * kSharpest));
}

}  // namespace

TargetArea MeasureTargetArea(const cv::Mat& gray, const std::vector<Observation>& markers) {
  std::vector<cv::Point> points, hull;
  for (const Observation& marker : markers) {
    points.emplace_back(cvRound(marker.values[0]), cvRound(marker.values[1]));
  }
  if (points.size() < 3) return {};
  const cv::Rect box = cv::boundingRect(points) & cv::Rect({0, 0}, gray.size());
  if (box.empty()) return {};
  cv::convexHull(points, hull);
  for (cv::Point& point : hull) point -= box.tl();
  cv::Mat inside(box.size(), CV_8U, cv::Scalar(0));
  cv::fillConvexPoly(inside, hull, cv::Scalar(1));
  const GrayCounts counts = CountGray(gray(box), inside);
  const double all = std::accumulate(counts.begin(), counts.end(), 0.0);
  // Compression makes 254 of some of the lightest pixels.
  const double lightest = counts[254] + counts[255];
  return {.blur = MeasureBlur(gray(box), inside, counts), .saturated = lightest / all};
}

}  // namespace plenocal::internal
