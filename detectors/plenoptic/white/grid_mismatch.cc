// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/grid_mismatch.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>

namespace plenocal::internal {
namespace {

/// Sums over cells of the regression raw - mean = s * expected, and its standard error.
struct Regression {
  double product = 0, square = 0;
  double product_square = 0, products = 0, squares = 0;  // over cells, for the error of s
  size_t cells = 0;

  void Add(double cell_product, double cell_square) {
    product += cell_product;
    square += cell_square;
    product_square += cell_product * cell_square;
    products += cell_product * cell_product;
    squares += cell_square * cell_square;
    ++cells;
  }
  [[nodiscard]] double Slope() const { return product / square; }
  /// From the scatter of the cells' own residuals product - s * square.
  [[nodiscard]] double Sigma() const {
    const double s = Slope();
    return std::sqrt(std::max(0.0, products - 2 * s * product_square + s * s * squares)) / square;
  }
};

constexpr int kParts = 3;  // along either side of the image
constexpr double kLeastSlope = 0.5;
/// Three standard errors between kLeastSlope and 1 distinguish the two cases.
constexpr double kMostSigma = (1 - kLeastSlope) / 3;

/// The regressions of the parts of the image and of the whole.
struct Regressions {
  std::array<Regression, kParts * kParts> parts;
  Regression whole;
};

Regressions CompareCells(const cv::Mat& raw,
                         const cv::Mat& attenuation,
                         const MicroLensArray& array) {
  // The circle around a cell of the hexagonal lattice.
  const double radius = array.Pitch() / std::sqrt(3.0);
  Regressions sums;
  for (const MicroLens& lens : array.lenses) {
    const Eigen::Vector2d& c = lens.centre;
    const int y0 = static_cast<int>(std::ceil(c.y() - radius));
    const int y1 = static_cast<int>(std::floor(c.y() + radius));
    if (!lens.usable || c.x() < radius || y0 < 0 || c.x() + radius > raw.cols - 1 ||
        y1 >= raw.rows) {
      continue;
    }
    double n = 0, si = 0, sv = 0, siv = 0, svv = 0;
    for (int y = y0; y <= y1; ++y) {
      const double half = std::sqrt(std::max(0.0, radius * radius - (y - c.y()) * (y - c.y())));
      const int x0 = static_cast<int>(std::ceil(c.x() - half));
      const int x1 = static_cast<int>(std::floor(c.x() + half));
      const auto *raw_row = raw.ptr<float>(y), *attenuation_row = attenuation.ptr<float>(y);
      for (int x = x0; x <= x1; ++x) {
        const double i = raw_row[x], v = attenuation_row[x];
        n += 1, si += i, sv += v, siv += i * v, svv += v * v;
      }
    }
    if (sv <= 0) continue;
    const double gain = si / sv;
    const double product = gain * (siv - si * sv / n), square = gain * gain * (svv - sv * sv / n);
    const int part = static_cast<int>(lens.centre.y() * kParts / raw.rows) * kParts +
                     static_cast<int>(lens.centre.x() * kParts / raw.cols);
    sums.parts[part].Add(product, square);
    sums.whole.Add(product, square);
  }
  return sums;
}

bool IsWrong(const Regression& r) {
  return r.cells > 1 && r.square > 0 && r.Sigma() < kMostSigma && r.Slope() < kLeastSlope;
}

}  // namespace

std::string GridMismatch(const cv::Mat& raw,
                         const cv::Mat& attenuation,
                         const MicroLensArray& array) {
  double darkest = 0, brightest = 0;
  cv::minMaxLoc(raw, &darkest, &brightest);
  if (brightest <= 0) return "is black; was the lens cap on?";

  const auto [parts, whole] = CompareCells(raw, attenuation, array);
  // An attenuation without micro images (for an image that was corrected already) checks nothing.
  if (!(whole.square > 0)) return "";
  if (IsWrong(whole) || whole.Sigma() >= kMostSigma) {
    return fmt::format(
        "does not show micro images where the grid has them (agreement {:.2f} +- {:.2f}, 1 is "
        "expected; mean grey value {:.1f}); it is {}",
        whole.Slope(),
        whole.Sigma(),
        cv::mean(raw)[0],
        IsWrong(whole) ? "of another camera or setting than the white images or their grid, or not "
                         "a raw plenoptic image"
                       : "too dark, or not a raw plenoptic image");
  }
  const auto bad = static_cast<size_t>(std::count_if(parts.begin(), parts.end(), IsWrong));
  if (bad > 0) {
    return fmt::format(
        "does not show micro images where the grid has them in {} of {} parts of the image; it is "
        "of another camera or setting than the white images",
        bad,
        parts.size());
  }
  return "";
}

}  // namespace plenocal::internal
