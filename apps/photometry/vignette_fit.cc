// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/vignette_fit.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>

#include "apps/photometry/vignette_splines.h"
#include "apps/photometry/wall_model.h"
#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

using Cell = WallModel::Cell;
using Expected = WallModel::Expected;

// Positions at the middles of a grid of cells over the image, from its middle in parts of its
// size; values of the spline there by its coefficients.
struct SplineGrid {
  Eigen::ArrayX2d places;
  Eigen::MatrixXd by_coefficients;
};

SplineGrid MakeSplineGrid(const ImageSpline& spline, const ImageSize& size, int columns, int rows) {
  SplineGrid grid{Eigen::ArrayX2d(columns * rows, 2),
                  Eigen::MatrixXd::Zero(columns * rows, spline.Coefficients())};
  for (int at = 0; at < columns * rows; ++at) {
    const double x = (at % columns + 0.5) / columns, y = (at / columns + 0.5) / rows;
    grid.places.row(at) << x - 0.5, y - 0.5;
    const ImageSpline::Basis basis = spline.At(x * size[0] - 0.5, y * size[1] - 0.5);
    for (size_t k = 0; k < ImageSpline::kSupport; ++k) {
      grid.by_coefficients(at, basis.index[k]) = basis.weight[k];
    }
  }
  return grid;
}

// Modes of v over the image with a standard deviation above half a percent.
std::vector<OpenMode> FindOpenModes(const SplineGrid& grid, const Eigen::MatrixXd& covariance) {
  constexpr double kOpen = 0.005, kAlike = 0.7;
  static constexpr std::array<const char*, 3> kNames{
      "a tilt along x", "a tilt along y", "a fall-off towards the border"};
  const Eigen::MatrixXd& B = grid.by_coefficients;
  Eigen::MatrixXd shapes(B.rows(), 3);
  shapes << grid.places.matrix(), (grid.places.square().rowwise().sum() - 1.0 / 6).matrix();
  const SymmetricEigen modes = DecomposeSymmetric(Eigen::MatrixXd(B * covariance * B.transpose()));
  std::vector<OpenMode> open;
  for (Eigen::Index m = B.rows() - 1; m >= 0; --m) {
    const double sigma = std::sqrt(std::max(modes.values[m], 0.0) / static_cast<double>(B.rows()));
    if (sigma < kOpen) break;
    Eigen::Index best = 0;
    const Eigen::VectorXd likeness = (shapes.transpose() * modes.vectors.col(m)).array().abs() /
                                     shapes.colwise().norm().transpose().array();
    likeness.maxCoeff(&best);
    open.push_back(
        {likeness[best] > kAlike ? kNames[static_cast<size_t>(best)] : "a slowly varying pattern",
         sigma});
  }
  return open;
}

void SetWall(const WallModel& model, VignetteEstimate* result) {
  const WallGrid& grid = model.Grid();
  result->wall = MakeImage({grid.columns, grid.rows}, model.Threads(), [&](int x, int y) {
    return std::exp(model.Brightness()[static_cast<size_t>(y)][static_cast<size_t>(x)]);
  });
  float largest = 0;
  for (const float brightness : cv::Mat_<float>(result->wall)) {
    if (brightness > largest) largest = brightness;
  }
  result->wall /= largest;
  result->wall_cell = grid.cell;
}

// Residuals of the worst parts of the wall against those of the best ones, each over what noise
// and the wall's own texture make of it: values between pixels and another blur leave a share of
// the contrast of neighbouring cells, which is the same everywhere.
double Unevenness(const WallModel& model) {
  const size_t columns = static_cast<size_t>(model.Grid().columns) / kBlockCells + 1;
  const size_t count = (model.Rows().size() / kBlockCells + 1) * columns;
  using Sums = Eigen::Array3Xd;  // square, noise, texture; by block
  const Sums blocks = model.SumSamples(
      Sums(Sums::Zero(3, static_cast<Eigen::Index>(count))),
      [&](const Cell& cell, const WallSample& s, const Expected& at, Sums* sum) {
        const double texture = model.Texture(cell);
        if (std::isnan(texture)) return;
        const size_t block = cell.row / kBlockCells * columns + cell.column / kBlockCells;
        sum->col(static_cast<Eigen::Index>(block)) +=
            Eigen::Array3d(Square(at.residual) / at.freedom, model.Noise(s, at.light), texture);
      });
  std::vector<double> shares, ratios;
  for (const auto& block : blocks.colwise()) {
    if (block[2] > 0) shares.push_back(std::max(block[0] - block[1], 0.0) / block[2]);
  }
  if (shares.empty()) return 0;
  const double share = Median(shares);
  for (const auto& block : blocks.colwise()) {
    if (block[2] > 0) ratios.push_back(block[0] / (block[1] + share * block[2]));
  }
  return Quantile(&ratios, 0.9) / Quantile(&ratios, 0.2);
}

void SetResiduals(const WallModel& model, VignetteEstimate* result) {
  // Angles of the views at the samples, in bins; their fifths are found from these.
  constexpr Eigen::Index kBins = 180;
  struct Sums {
    Eigen::Array2Xd bins;               // weight, weight * residual
    Eigen::Array<double, 5, 1> totals;  // squares, spreads, robust weights; outliers, samples

    Sums& operator+=(const Sums& more) {
      bins += more.bins;
      totals += more.totals;
      return *this;
    }
  };
  const Sums sums = model.SumSamples(
      Sums{Eigen::Array2Xd::Zero(2, kBins), Eigen::Array<double, 5, 1>::Zero()},
      [&](const Cell& cell, const WallSample& s, const Expected& at, Sums* sum) {
        const RigidTransform& T = model.Wall().views[s.view].T_camera_wall;
        const Eigen::Vector3d p =
            T * model.Grid().At(static_cast<int>(cell.column), static_cast<int>(cell.row));
        const double cosine = std::min(std::abs(T.R.col(2).dot(p)) / p.norm(), 1.0);
        const auto bin =
            static_cast<Eigen::Index>(std::acos(cosine) / std::numbers::pi * 2 * (kBins - 1));
        sum->bins.col(bin) += Eigen::Array2d(at.weight, at.weight * at.residual);
        constexpr double kBeyond = 3;
        const double square = Square(at.residual), spread = model.Noise(s, at.light) * at.freedom;
        const double robust = TukeyWeight(square / (Square(kTukeyWidth) * spread));
        sum->totals[0] += robust * square;
        sum->totals[1] += robust * spread;
        sum->totals[2] += robust;
        sum->totals[3] += square > Square(kBeyond) * spread ? 1 : 0;
        sum->totals[4] += 1;
      });
  result->unevenness = Unevenness(model);
  result->residual = std::sqrt(sums.totals[0] / sums.totals[2]);
  result->expected = std::sqrt(sums.totals[1] / sums.totals[2]);
  result->outliers = sums.totals[3] / sums.totals[4];
  result->measurements = static_cast<size_t>(sums.totals[4]);
  const double total = sums.bins.row(0).sum();
  double passed = 0, residual = 0, weight = 0;
  size_t fifth = 0;
  for (Eigen::Index i = 0; i < kBins; ++i) {
    passed += sums.bins(0, i);
    weight += sums.bins(0, i);
    residual += sums.bins(1, i);
    const double angle = (static_cast<double>(i) + 1) * std::numbers::pi / 2 / (kBins - 1);
    while (fifth < 5 && passed >= total * (static_cast<double>(fifth) + 1) / 5 * (1 - 1e-12)) {
      result->by_angle[fifth] = weight > 0 ? residual / weight : 0;
      result->angle_limits[++fifth] = angle;
      weight = residual = 0;
    }
  }
}

// Views with a roll near that of most, and those rotated by 90 or 180 degrees, must find the same
// v: light that goes with the camera does not rotate with it.
ShadingTest TestShading(const WallModel& model, const VignetteSplines& splines) {
  std::vector<double> rolls;
  for (const WallView& view : model.Wall().views) {
    const Eigen::Vector3d right = view.T_camera_wall.R.row(0);  // camera's x on the wall
    rolls.push_back(std::atan2(right.y(), right.x()));
  }
  constexpr double kWidth = std::numbers::pi / 4;
  const auto near = [](double a, double b) {
    return std::abs(std::remainder(a - b, 2 * std::numbers::pi)) < kWidth;
  };
  const auto count = [&](double roll) {
    return std::ranges::count_if(rolls, [&](double other) { return near(other, roll); });
  };
  const double usual = *std::ranges::max_element(rolls, {}, count);
  std::vector<bool> upright, turned;
  for (const double roll : rolls) {
    upright.push_back(near(roll, usual));
    turned.push_back(std::abs(std::remainder(roll - usual, 2 * std::numbers::pi)) > 1.5 * kWidth);
  }
  constexpr std::ptrdiff_t kFewest = 8;
  ShadingTest test;
  if (std::ranges::count(upright, true) < kFewest || std::ranges::count(turned, true) < kFewest) {
    return test;
  }
  test.tested = true;
  const CoarseSystem a = splines.MakeCoarseSystem(upright), b = splines.MakeCoarseSystem(turned);
  const Eigen::Index nv = splines.Coarse().Coefficients();
  const Eigen::VectorXd difference = a.Solve().head(nv) - b.Solve().head(nv);
  const Eigen::MatrixXd covariance =
      Inverse(a.S).topLeftCorner(nv, nv) + Inverse(b.S).topLeftCorner(nv, nv);
  // Tilts and the second order, by least squares over the image.
  constexpr int kSide = 8, kTerms = 5;
  const SplineGrid grid =
      MakeSplineGrid(splines.Coarse(), model.Wall().camera->image_size, kSide, kSide);
  const Eigen::ArrayXd x = grid.places.col(0), y = grid.places.col(1);
  Eigen::ArrayXXd powers(kSide * kSide, kTerms + 1);
  powers << x, y, x * x, x * y, y * y, Eigen::ArrayXd::Ones(kSide * kSide);
  const Eigen::MatrixXd P = powers;
  const Eigen::MatrixXd fit = PseudoInverse(P).topRows(kTerms) * grid.by_coefficients;
  const Eigen::VectorXd terms = fit * difference;
  const Eigen::MatrixXd terms_covariance = fit * covariance * fit.transpose();
  const double chi_square = terms.dot(SolveSymmetric(terms_covariance, terms));
  test.chance = ChiSquareTail(kTerms, chi_square);
  const Eigen::MatrixXd centred =
      P.leftCols(kTerms).rowwise() - P.leftCols(kTerms).colwise().mean();
  test.difference = (centred * terms).norm() / kSide;
  test.sigma = std::sqrt((centred * terms_covariance * centred.transpose()).trace()) / kSide;
  return test;
}

VignetteEstimate MakeEstimate(const WallModel& model, const VignetteSplines& splines) {
  VignetteEstimate result;
  for (size_t v = 0; v < model.Wall().views.size(); ++v) {
    if (model.Used()[static_cast<Eigen::Index>(v)] == 0) {
      result.misplaced.push_back(model.Wall().views[v].frame);
    }
  }
  const CoarseSystem system = splines.MakeCoarseSystem();
  const Eigen::Index nv = splines.Coarse().Coefficients();
  const Eigen::MatrixXd all = splines.CoarseCovariance(system);
  const Eigen::MatrixXd covariance = all.topLeftCorner(nv, nv);
  result.attenuation = splines.FineAttenuation();
  result.sigma = splines.FineSigma(system, covariance);
  constexpr int kColumns = 12, kRows = 9;
  result.open = FindOpenModes(
      MakeSplineGrid(splines.Coarse(), model.Wall().camera->image_size, kColumns, kRows),
      covariance);
  // Sigmas of gains against their mean: an error that all share is one of the wall's brightness.
  const Eigen::MatrixXd of_gains = all.bottomRightCorner(all.rows() - nv, all.rows() - nv);
  const Eigen::VectorXd share = model.Used() / model.Used().sum(), means = of_gains * share;
  for (Eigen::Index i = 0; i < means.size(); ++i) {
    result.gains.push_back(std::exp(model.Gains()[i]));
    result.gain_sigma.push_back(std::sqrt(of_gains(i, i) - 2 * means[i] + share.dot(means)));
  }
  SetWall(model, &result);
  SetResiduals(model, &result);
  result.shading = TestShading(model, splines);
  return result;
}

}  // namespace

VignetteEstimate FitVignette(WallRecording wall,
                             const std::string& where,
                             int threads,
                             const std::function<bool(const std::string& stage)>& progress) {
  const auto report = [&](const char* stage) {
    if (!progress(stage)) throw Stopped();
  };
  report("wall: points in all images");
  WallModel model(std::move(wall), where, threads);
  VignetteSplines splines(&model);
  constexpr size_t kFewest = 20000;
  if (model.Measurements() < kFewest) {
    throw JobError(
        "{}: the images have only {} measurements of points that at least three "
        "of them show; move the camera less between images, avoid saturation",
        where,
        model.Measurements());
  }
  report("wall: first rounds");
  splines.Round();
  splines.Round();
  const auto refine_poses = [&] {
    report("wall: poses by its texture");
    model.RefinePoses();
    splines.Round();
  };
  for (int i = 0; i < 3; ++i) refine_poses();
  while (model.LeaveOutMisplaced()) splines.Round();
  model.EstimateNoise();
  refine_poses();
  model.EstimateNoise();
  report("wall: last rounds");
  for (int i = 0; i < 3; ++i) splines.Round();
  model.EstimateNoise();
  splines.Round();
  report("wall: standard deviations");
  model.EstimateWall();
  return MakeEstimate(model, splines);
}

}  // namespace plenocal
