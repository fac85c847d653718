// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/grid_mismatch.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <optional>

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

/// The circle around a cell of the hexagonal lattice.
double CellRadius(const MicroLensArray& array) { return array.Pitch() / std::sqrt(3.0); }

/// Whether a cell and a margin around it are in the image.
bool IsWhole(const MicroLens& lens, double radius, const cv::Mat& image) {
  const Eigen::Vector2d& c = lens.centre;
  return lens.usable && c.minCoeff() >= radius && c.x() + radius <= image.cols - 1 &&
         c.y() + radius <= image.rows - 1;
}

/// Calls use(x, y) for the pixels of a cell.
template <typename Use>
void ForEachPixel(const Eigen::Vector2d& c, double radius, const Use& use) {
  const int y0 = static_cast<int>(std::ceil(c.y() - radius));
  const int y1 = static_cast<int>(std::floor(c.y() + radius));
  for (int y = y0; y <= y1; ++y) {
    const double half = std::sqrt(std::max(0.0, radius * radius - (y - c.y()) * (y - c.y())));
    const int x0 = static_cast<int>(std::ceil(c.x() - half));
    const int x1 = static_cast<int>(std::floor(c.x() + half));
    for (int x = x0; x <= x1; ++x) use(x, y);
  }
}

Regressions CompareCells(const cv::Mat& raw,
                         const cv::Mat& attenuation,
                         const MicroLensArray& array) {
  const double radius = CellRadius(array);
  Regressions sums;
  for (const MicroLens& lens : array.lenses) {
    if (!IsWhole(lens, radius, raw)) continue;
    double n = 0, si = 0, sv = 0, siv = 0, svv = 0;
    ForEachPixel(lens.centre, radius, [&](int x, int y) {
      const double i = raw.at<float>(y, x), v = attenuation.at<float>(y, x);
      n += 1, si += i, sv += v, siv += i * v, svv += v * v;
    });
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

/// Normal equations.
template <int kUnknowns>
struct Sums {
  Eigen::Matrix<double, kUnknowns, kUnknowns> normal =
      Eigen::Matrix<double, kUnknowns, kUnknowns>::Zero();
  Eigen::Matrix<double, kUnknowns, 1> right = Eigen::Matrix<double, kUnknowns, 1>::Zero();
};

/// Those of one cell for the displacement of its micro image, px, without gain and gradient of the
/// scene; the attenuation is displaced by `whole` pixels. Nothing for a cell without light.
std::optional<Sums<2>> ShiftOfCell(const cv::Mat& raw,
                                   const cv::Mat& attenuation,
                                   const Eigen::Vector2i& whole,
                                   const Eigen::Vector2d& centre,
                                   double radius,
                                   const std::array<float, 4>& by_place) {
  using Vector6d = Eigen::Matrix<double, 6, 1>;
  Eigen::Matrix<double, 6, 6> sums = Eigen::Matrix<double, 6, 6>::Zero();
  double light = 0, white = 0, pixels = 0;
  ForEachPixel(centre, radius, [&](int x, int y) {
    const auto v = [&](int dx, int dy) -> double {
      return attenuation.at<float>(y - whole.y() + dy, x - whole.x() + dx);
    };
    const double i = raw.at<float>(y, x) * by_place[static_cast<size_t>(2 * (y & 1) + (x & 1))];
    Vector6d row;
    row << v(0, 0), v(0, 0) * (x - centre.x()) / radius, v(0, 0) * (y - centre.y()) / radius,
        (8 * (v(-1, 0) - v(1, 0)) - v(-2, 0) + v(2, 0)) / 12,
        (8 * (v(0, -1) - v(0, 1)) - v(0, -2) + v(0, 2)) / 12, i;
    sums.selfadjointView<Eigen::Lower>().rankUpdate(row);
    light += i, white += v(0, 0), pixels += 1;
  });
  if (light <= 0 || white <= 0) return std::nullopt;
  const Eigen::Matrix3d lower = sums.bottomLeftCorner<3, 3>();
  const Eigen::Matrix3d of_scene = sums.topLeftCorner<3, 3>().selfadjointView<Eigen::Lower>();
  const Eigen::Matrix3d all = sums.bottomRightCorner<3, 3>().selfadjointView<Eigen::Lower>();
  const Eigen::Matrix3d rest = all - lower * of_scene.ldlt().solve(lower.transpose());
  constexpr double kLeastNoise = 0.005;  // of the brightness: no cell may outweigh all others
  const double gain = light / white;
  const double variance = std::max(rest(2, 2) / pixels, std::pow(kLeastNoise * gain, 2));
  const Sums<2> cell{gain * gain / variance * rest.topLeftCorner<2, 2>(),
                     gain / variance * rest.topRightCorner<2, 1>()};
  if (!cell.normal.allFinite() || !cell.right.allFinite()) return std::nullopt;
  return cell;
}

/// `MeasureLatticeShift` to first order in what the displacement differs from `start`.
LatticeShift ShiftFrom(const Eigen::Vector4d& start,
                       const cv::Mat& raw,
                       const cv::Mat& attenuation,
                       const MicroLensArray& array,
                       const std::array<float, 4>& by_place) {
  constexpr size_t kCells = 4000;  // as many as are needed
  constexpr double kBeside = 2;    // px, of derivatives
  // Neighbours show the same structure of the scene, so the scatter is that of blocks.
  constexpr int kBlocks = 4;  // along either side of the image
  const double radius = CellRadius(array);
  const Eigen::Vector2d middle(raw.cols / 2.0, raw.rows / 2.0);
  std::array<Sums<4>, kBlocks * kBlocks> blocks;
  for (size_t i = 0; i < array.lenses.size(); i += 1 + array.lenses.size() / kCells) {
    const MicroLens& lens = array.lenses[i];
    const Eigen::Vector2d at = (lens.centre - middle) / middle.norm();
    Eigen::Matrix<double, 2, 4> by_shift;
    by_shift << 1, 0, at.x(), -at.y(), 0, 1, at.y(), at.x();
    const Eigen::Vector2i whole = (by_shift * start).array().round().cast<int>();
    MicroLens moved = lens;
    moved.centre += whole.cast<double>();
    if (!IsWhole(lens, radius + kBeside, raw) || !IsWhole(moved, radius + kBeside, raw)) continue;
    const auto cell = ShiftOfCell(raw, attenuation, whole, moved.centre, radius, by_place);
    if (!cell) continue;
    Sums<4>& block = blocks[static_cast<size_t>(lens.centre.y() * kBlocks / raw.rows) * kBlocks +
                            static_cast<size_t>(lens.centre.x() * kBlocks / raw.cols)];
    block.normal += by_shift.transpose() * cell->normal * by_shift;
    block.right += by_shift.transpose() * (cell->right + cell->normal * whole.cast<double>());
  }
  Sums<4> all;
  for (const Sums<4>& block : blocks) all.normal += block.normal, all.right += block.right;
  const Eigen::LDLT<Eigen::Matrix4d> solver(all.normal);
  constexpr double kLeastEdge = 1;  // px^-2 of information
  if (solver.info() != Eigen::Success || solver.vectorD().minCoeff() < kLeastEdge) return {};
  LatticeShift shift{.value = solver.solve(all.right), .corner = middle.norm()};
  // The jackknife takes the weight of single blocks into account.
  Eigen::Array4d squares = Eigen::Array4d::Zero();
  for (const Sums<4>& block : blocks) {
    const Eigen::Matrix4d without = all.normal - block.normal;
    squares += (without.ldlt().solve(all.right - block.right) - shift.value).array().square();
  }
  shift.sigma = squares.sqrt();
  return shift;
}

}  // namespace

LatticeShift MeasureLatticeShift(const cv::Mat& raw,
                                 const cv::Mat& attenuation,
                                 const MicroLensArray& array,
                                 const std::array<float, 4>& by_place) {
  constexpr int kSteps = 10;
  LatticeShift shift = ShiftFrom(Eigen::Vector4d::Zero(), raw, attenuation, array, by_place);
  double change = shift.Largest();
  for (int step = 1; step < kSteps && change > kLeastLatticeShift; ++step) {
    // Below half a pixel the next step is the same; beyond the pitch there is nothing to find.
    if (shift.Largest() < 0.5 || shift.Largest() > array.Pitch()) break;
    const Eigen::Vector4d before = shift.value;
    // The first order of edges narrower than the displacement is too small.
    shift = ShiftFrom((step == 1 ? 2 : 1) * before, raw, attenuation, array, by_place);
    if (step > 1) change = (shift.value - before).norm();
  }
  return shift;
}

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
