// SPDX-License-Identifier: Apache-2.0
#include "detectors/photometry/photon_transfer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <span>
#include <utility>

#include "calib/base/number_text.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"
#include "detectors/images/white_images.h"

namespace plenocal {
namespace {

/// Side of the square, px, over which a white image and the mean of all may differ by a factor: the
/// lamp flickers and is moved. It takes a thousandth of the degrees of freedom.
constexpr int kShadingSide = 31;
/// Levels of the curve, of equal numbers of pixels.
constexpr size_t kLevels = 32;
/// A good pixel is called defective with this probability over the whole image.
constexpr double kGoodCalledDefective = 0.01;
/// Good pixels differ in sensitivity with longer tails than a normal distribution has.
constexpr double kDefectSigmas = 10;

/// What the white images have at each pixel.
struct PixelSums {
  cv::Mat squares;          ///< CV_32F: of deviations from the mean
  cv::Mat lowest, highest;  ///< CV_32F
};

/// A pixel of the images, with all that is asked about it: pixels of one level lie all over the
/// image.
struct PixelNoise {
  float level = 0, variance = 0;  ///< mean grey value and variance over the images
  float scatter = 0;              ///< distance of the level from the mean of its neighbours
  float beyond = 0;  ///< level above the highest of the neighbours, or below the lowest (negative)
  std::int32_t index = 0;
};

PixelSums SumPixels(const std::vector<FrameImage>& images, const WhiteImages& white) {
  const cv::Size window(kShadingSide, kShadingSide);
  cv::Mat smooth_mean;
  cv::blur(white.mean, smooth_mean, window, {-1, -1}, cv::BORDER_REFLECT);
  cv::max(smooth_mean, 1, smooth_mean);
  PixelSums sums{.squares = cv::Mat::zeros(white.mean.size(), CV_32F),
                 .lowest = cv::Mat(white.mean.size(), CV_32F, cv::Scalar(1e9)),
                 .highest = cv::Mat::zeros(white.mean.size(), CV_32F)};
  for (const size_t i : white.members) {
    cv::Mat image, shading;
    white.Gray(images, i).convertTo(image, CV_32F);
    cv::min(sums.lowest, image, sums.lowest);
    cv::max(sums.highest, image, sums.highest);
    cv::blur(image, shading, window, {-1, -1}, cv::BORDER_REFLECT);
    const cv::Mat deviation = image - white.mean.mul(shading / smooth_mean);
    cv::accumulateSquare(deviation, sums.squares);
  }
  return sums;
}

// Means of the eight nearest pixels of the same colour; the highest and the lowest of them.
struct Neighbours {
  cv::Mat mean, highest, lowest;
};

Neighbours NeighboursOf(const cv::Mat& image, std::optional<BayerOrder> bayer) {
  const int step = bayer ? 2 : 1;
  cv::Mat kernel = cv::Mat::zeros(2 * step + 1, 2 * step + 1, CV_32F);
  for (int y = 0; y <= 2; ++y) {
    for (int x = 0; x <= 2; ++x) kernel.at<float>(y * step, x * step) = x == 1 && y == 1 ? 0 : 1;
  }
  cv::Mat shape;
  kernel.convertTo(shape, CV_8U);
  Neighbours around;
  cv::filter2D(image, around.mean, CV_32F, kernel / 8, {-1, -1}, 0, cv::BORDER_REFLECT_101);
  cv::dilate(image, around.highest, shape, {-1, -1}, 1, cv::BORDER_REFLECT_101);
  cv::erode(image, around.lowest, shape, {-1, -1}, 1, cv::BORDER_REFLECT_101);
  return around;
}

// Pixels that are clipped in no image.
std::vector<PixelNoise> UsablePixels(const WhiteImages& white,
                                     const PixelSums& sums,
                                     const Neighbours& around,
                                     int dof) {
  std::vector<PixelNoise> pixels;
  pixels.reserve(white.mean.total());
  for (int y = 0; y < white.mean.rows; ++y) {
    for (int x = 0; x < white.mean.cols; ++x) {
      if (sums.lowest.at<float>(y, x) <= 0) continue;
      if (sums.highest.at<float>(y, x) >= static_cast<float>(white.full_scale)) continue;
      const float level = white.mean.at<float>(y, x);
      pixels.push_back({.level = level,
                        .variance = sums.squares.at<float>(y, x) / static_cast<float>(dof),
                        .scatter = std::abs(level - around.mean.at<float>(y, x)),
                        .beyond = level - std::clamp(level,
                                                     around.lowest.at<float>(y, x),
                                                     around.highest.at<float>(y, x)),
                        .index = y * white.mean.cols + x});
    }
  }
  return pixels;
}

// Index of the first pixel of a level.
size_t LevelStart(size_t level, size_t levels, size_t pixels) { return level * pixels / levels; }

// Sorts the pixels by level, those of one level by index as they come: counting sorts by some bits
// of the level at a time. Levels are positive, so that their bits ascend with them.
void SortByLevel(std::vector<PixelNoise>* pixels) {
  constexpr int kBits = 11;  // three sorts, each with no more places than a cache holds
  std::vector<PixelNoise> sorted(pixels->size());
  for (int shift = 0; shift < std::numeric_limits<std::uint32_t>::digits; shift += kBits) {
    const auto digit = [&](const PixelNoise& pixel) {
      return (std::bit_cast<std::uint32_t>(pixel.level) >> shift) % (1U << kBits);
    };
    std::array<size_t, (1U << kBits) + 1> starts{};
    for (const PixelNoise& pixel : *pixels) ++starts[digit(pixel) + 1];
    std::partial_sum(starts.begin(), starts.end(), starts.begin());
    for (const PixelNoise& pixel : *pixels) sorted[starts[digit(pixel)]++] = pixel;
    pixels->swap(sorted);
  }
}

// Without pixels of far more noise than the others, which would else be the level's.
NoiseLevel LevelOf(const PixelNoise* begin, const PixelNoise* end, int dof) {
  const double count = static_cast<double>(end - begin);
  const double ratio = ChiSquareQuantile(dof, kGoodCalledDefective / count) / dof;
  NoiseLevel level;
  double limit = std::numeric_limits<double>::infinity();
  for (int round = 0; round < 4; ++round) {
    double used = 0, levels = 0, variances = 0;
    for (const PixelNoise* pixel = begin; pixel != end; ++pixel) {
      if (pixel->variance > limit) continue;
      ++used;
      levels += pixel->level;
      variances += pixel->variance;
    }
    level = {levels / used, variances / used, variances / used * std::sqrt(2 / (dof * used))};
    limit = ratio * level.variance;
  }
  return level;
}

// Sorts the pixels into the levels.
std::vector<NoiseLevel> LevelsOf(int dof, std::vector<PixelNoise>* pixels) {
  std::vector<NoiseLevel> levels;
  const size_t count = std::min(kLevels, pixels->size() / 100 + 1);
  SortByLevel(pixels);
  for (size_t k = 0; k < count; ++k) {
    const PixelNoise* data = pixels->data();
    levels.push_back(LevelOf(data + LevelStart(k, count, pixels->size()),
                             data + LevelStart(k + 1, count, pixels->size()),
                             dof));
  }
  return levels;
}

// Weighted line through the levels; standard errors from their scatter where it is larger than
// theirs.
void FitLine(PhotonTransfer* noise) {
  double w_sum = 0, x_sum = 0, y_sum = 0;
  for (const NoiseLevel& level : noise->levels) {
    const double w = 1 / std::max(level.sigma * level.sigma, 1e-12);
    w_sum += w;
    x_sum += w * level.level;
    y_sum += w * level.variance;
  }
  const double x_mean = x_sum / w_sum, y_mean = y_sum / w_sum;
  double xx = 0, xy = 0;
  for (const NoiseLevel& level : noise->levels) {
    const double w = 1 / std::max(level.sigma * level.sigma, 1e-12);
    xx += w * (level.level - x_mean) * (level.level - x_mean);
    xy += w * (level.level - x_mean) * (level.variance - y_mean);
  }
  const double infinity = std::numeric_limits<double>::infinity();
  double slope = xx > 0 ? std::max(xy / xx, 0.0) : 0;
  // A sensor's variance has no negative part: what a steeper line saves there is noise.
  if (x_mean > 0) slope = std::min(slope, y_mean / x_mean);
  const double offset = y_mean - slope * x_mean;
  double chi_square = 0, squares = 0;
  for (const NoiseLevel& level : noise->levels) {
    const double expected = offset + slope * level.level, r = level.variance - expected;
    chi_square += r * r / std::max(level.sigma * level.sigma, 1e-12);
    squares += r * r / std::max(expected * expected, 1e-12);
  }
  const auto count = static_cast<double>(noise->levels.size());
  const double factor = count > 2 ? std::max(1.0, chi_square / (count - 2)) : 1;
  noise->gain = slope;
  noise->gain_sigma = xx > 0 ? std::sqrt(factor / xx) : infinity;
  noise->read = std::sqrt(std::max(offset, 0.0));  // rounding
  const double offset_sigma = std::sqrt(factor * (1 / w_sum + x_mean * x_mean / xx));
  noise->read_sigma =
      xx > 0 ? offset_sigma / std::max(2 * noise->read, std::sqrt(offset_sigma)) : infinity;
  noise->misfit = std::sqrt(squares / count);
}

// Robust standard deviation of pixels of one level about their neighbours. The flanks of micro
// images, where neighbours differ, belong to the level too.
double ScatterOf(std::span<const PixelNoise> level) {
  std::vector<float> scatter;
  scatter.reserve(level.size());
  for (const PixelNoise& pixel : level) scatter.push_back(pixel.scatter);
  return kSigmaPerMad * Median(std::move(scatter), 0.0F);
}

std::vector<DefectivePixel> FindDefects(const std::vector<PixelNoise>& pixels,
                                        const PhotonTransfer& noise,
                                        int dof,
                                        int columns) {
  std::vector<DefectivePixel> defects;
  // Twice the noise of its level at least: the levels themselves are not that exact.
  const double most_variance = std::max(
      4.0, ChiSquareQuantile(dof, kGoodCalledDefective / static_cast<double>(pixels.size())) / dof);
  for (size_t k = 0; k < noise.levels.size(); ++k) {
    const size_t first = LevelStart(k, noise.levels.size(), pixels.size());
    const size_t last = LevelStart(k + 1, noise.levels.size(), pixels.size());
    const std::span<const PixelNoise> level(pixels.data() + first, last - first);
    const double sigma = std::max(ScatterOf(level), 1e-9);
    for (const PixelNoise& pixel : level) {
      const double variance = pixel.variance / noise.levels[k].variance;
      const double beyond = pixel.beyond / sigma;
      const int x = pixel.index % columns, y = pixel.index / columns;
      if (variance > most_variance) {
        defects.push_back({x, y, PixelDefect::kNoisy, std::sqrt(variance)});
      } else if (beyond > kDefectSigmas) {
        defects.push_back({x, y, PixelDefect::kBright, beyond});
      } else if (-beyond > kDefectSigmas) {
        defects.push_back({x, y, PixelDefect::kDark, -beyond});
      }
    }
  }
  std::ranges::sort(defects, {}, [](const DefectivePixel& d) { return std::pair(d.y, d.x); });
  return defects;
}

const char* NameOf(PixelDefect defect) {
  static constexpr std::array<const char*, 3> kNames = {"bright", "dark", "noisy"};
  return kNames[static_cast<size_t>(defect)];
}

}  // namespace

std::optional<PhotonTransfer> MeasurePhotonTransfer(const std::vector<FrameImage>& images,
                                                    const WhiteImages& white,
                                                    std::optional<BayerOrder> bayer) {
  if (white.members.size() < 2) return {};
  const int dof = static_cast<int>(white.members.size()) - 1;
  // The sums and neighbours, six images, are released before the pixels are sorted.
  std::vector<PixelNoise> pixels =
      UsablePixels(white, SumPixels(images, white), NeighboursOf(white.mean, bayer), dof);
  if (pixels.empty()) return {};
  PhotonTransfer noise{.saturation = white.full_scale};
  noise.levels = LevelsOf(dof, &pixels);
  FitLine(&noise);
  noise.defects = FindDefects(pixels, noise, dof, white.mean.cols);
  return noise;
}

std::string PhotonTransferYaml(const PhotonTransfer& noise) {
  std::string text = fmt::format(
      "plenocal: 1\n"
      "gain: {{value: {}, sigma: {}}}\n"
      "read: {{value: {}, sigma: {}}}\n"
      "saturation: {}\n"
      "misfit: {}\n"
      "levels:  # mean grey value, variance and its standard error\n",
      YamlNumber(noise.gain),
      YamlNumber(noise.gain_sigma),
      YamlNumber(noise.read),
      YamlNumber(noise.read_sigma),
      YamlNumber(noise.saturation),
      YamlNumber(noise.misfit));
  for (const NoiseLevel& level : noise.levels) {
    text += fmt::format("  - [{}, {}, {}]\n",
                        YamlNumber(level.level),
                        YamlNumber(level.variance),
                        YamlNumber(level.sigma));
  }
  text += noise.defects.empty() ? "defects: []\n" : "defects:\n";
  for (const DefectivePixel& pixel : noise.defects) {
    text += fmt::format("  - {{x: {}, y: {}, defect: {}, excess: {:.1f}}}\n",
                        pixel.x,
                        pixel.y,
                        NameOf(pixel.defect),
                        pixel.excess);
  }
  return text;
}

}  // namespace plenocal
