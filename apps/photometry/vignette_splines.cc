// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/vignette_splines.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "calib/base/linear_algebra.h"

namespace plenocal {
namespace {

constexpr double kGainSigma = 0.02;  // of exposures that are known, as shutters and lamps have it
constexpr double kUnknownGain = 3;   // ln units: any
constexpr double kCoarseCells = 8;   // of the spline, along the longer side

using Cell = WallModel::Cell;
using Expected = WallModel::Expected;

// Scores of the coarse unknowns by blocks of the wall.
struct BlockScatter {
  Eigen::MatrixXd M, blocks;  // blocks: of one row of them, in columns
  size_t row = 0;
  double count = 0;

  void FinishRow() {
    M.noalias() += blocks * blocks.transpose();
    count += static_cast<double>((blocks.colwise().squaredNorm().array() > 0).count());
    blocks.setZero();
  }
  BlockScatter& operator+=(BlockScatter& more) {
    more.FinishRow();
    M += more.M;
    count += more.count;
    return *this;
  }
};

}  // namespace

CoarseSystem& CoarseSystem::operator+=(const CoarseSystem& more) {
  S += more.S;
  known += more.known;
  b += more.b;
  return *this;
}

Eigen::VectorXd CoarseSystem::Solve() const { return SolveSymmetric(S, b); }

VignetteSplines::VignetteSplines(WallModel* model)
    : model_(*model),
      longer_(std::ranges::max(model->Wall().camera->image_size)),
      fine_(MakeAttenuationSpline(model->Wall().camera->image_size)),
      coarse_(model->Wall().camera->image_size, longer_ / kCoarseCells) {}

void VignetteSplines::Round() {
  const cv::Size size = model_.Attenuation().size();
  const WallProjector& projector = model_.Projector();
  model_.EstimateWall();
  const Eigen::VectorXd step = MakeCoarseSystem().Solve();
  const Eigen::VectorXd coefficients = step.head(coarse_.Coefficients());
  model_.SetAttenuation(model_.Attenuation() + MakeImage(size, model_.Threads(), [&](int x, int y) {
                          return coarse_.Evaluate(
                              coefficients, projector.Enlarge(x), projector.Enlarge(y));
                        }));
  model_.ChangeGains(step.tail(model_.Gains().size()));
  model_.EstimateWall();
  fine_coefficients_ = MakeFineFit().Solve();
  model_.SetAttenuation(MakeImage(size, model_.Threads(), [&](int x, int y) {
    return fine_.Evaluate(fine_coefficients_, projector.Enlarge(x), projector.Enlarge(y));
  }));
}

// At a position in the reduced image.
ImageSpline::Basis VignetteSplines::CoarseAt(double x, double y) const {
  return coarse_.At(model_.Projector().Enlarge(x), model_.Projector().Enlarge(y));
}

CoarseSystem VignetteSplines::MakeCoarseSystem(const std::vector<bool>& only) const {
  const Eigen::Index nv = coarse_.Coefficients(), n = nv + model_.Gains().size();
  const std::vector<WallRow>& rows = model_.Rows();
  // The work grows with the square of the unknowns; thinned cells are as good a sample.
  constexpr double kMostWork = 4e10;
  const double work =
      static_cast<double>(model_.Grid().rows) * model_.Grid().columns * static_cast<double>(n * n);
  const auto step = static_cast<size_t>(std::max(1.0, std::ceil(work / kMostWork)));
  const CoarseSystem zero{
      Eigen::MatrixXd::Zero(n, n), Eigen::MatrixXd::Zero(nv, nv), Eigen::VectorXd::Zero(n)};
  CoarseSystem system = SumParts(zero, model_.Threads(), [&](size_t part, CoarseSystem* sum) {
    constexpr Eigen::Index kBatch = 128;
    Eigen::MatrixXd batch = Eigen::MatrixXd::Zero(n, kBatch);
    Eigen::VectorXd batch_b(kBatch);
    Eigen::Index filled = 0;
    const auto flush = [&] {
      if (filled == 0) return;
      sum->S.selfadjointView<Eigen::Lower>().rankUpdate(batch.leftCols(filled), -1.0);
      sum->b.noalias() -= batch.leftCols(filled) * batch_b.head(filled);
      batch.leftCols(filled).setZero();
      filled = 0;
    };
    for (size_t r = part; r < rows.size(); r += kSumParts) {
      for (size_t cell = r % step; cell + 1 < rows[r].begin.size(); cell += step) {
        if (std::isnan(model_.Brightness()[r][cell])) continue;
        double total = 0, total_b = 0;
        auto column = batch.col(filled);
        for (const WallSample& s : rows[r].Samples(cell)) {
          if (!only.empty() && !only[s.view]) continue;
          const Expected at = model_.Expect(s, {r, cell});
          const double residual = at.residual, w = at.weight;
          if (!(w > 0)) continue;
          const ImageSpline::Basis basis = CoarseAt(s.x, s.y);
          const Eigen::Index g = nv + s.view;
          for (size_t a = 0; a < ImageSpline::kSupport; ++a) {
            const double wa = w * basis.weight[a];
            const Eigen::Index ia = basis.index[a];
            for (size_t b = 0; b <= a; ++b) sum->known(ia, basis.index[b]) += wa * basis.weight[b];
            sum->S(g, ia) += wa;
            sum->b[ia] += wa * residual;
            column[ia] += wa;
          }
          sum->S(g, g) += w;
          sum->b[g] += w * residual;
          column[g] += w;
          total += w;
          total_b += w * residual;
        }
        if (!(total > 0)) continue;
        column /= std::sqrt(total);
        batch_b[filled] = total_b / std::sqrt(total);
        if (++filled == kBatch) flush();
      }
    }
    flush();
    sum->S.topLeftCorner(nv, nv) += sum->known;
  });
  system.S *= static_cast<double>(step);
  system.known *= static_cast<double>(step);
  system.b *= static_cast<double>(step);
  system.S = system.S.selfadjointView<Eigen::Lower>();
  system.known = system.known.selfadjointView<Eigen::Lower>();
  AddPriors(&system);
  return system;
}

double VignetteSplines::GainSigma() const {
  return model_.Wall().exposures_known ? kGainSigma : kUnknownGain;
}

// Gains about 1; mean of v 0, for a factor of it is one of the wall; and hardly any curvature where
// there are no data.
void VignetteSplines::AddPriors(CoarseSystem* system) const {
  const Eigen::Index nv = coarse_.Coefficients(), ng = model_.Gains().size();
  system->S.diagonal().tail(ng).array() += 1 / Square(GainSigma());
  system->b.tail(ng) -= model_.Gains() / Square(GainSigma());
  const double scale = system->known.diagonal().mean();
  const Eigen::VectorXd mean = MeanOfCoarse();
  system->S.topLeftCorner(nv, nv) += scale * static_cast<double>(nv) * mean * mean.transpose();
  constexpr double kHardly = 1e-6;
  system->S.topLeftCorner(nv, nv).diagonal().array() += kHardly * scale;
  system->known.diagonal().array() += kHardly * scale;
}

// v's mean over the image = its product with the coefficients.
Eigen::VectorXd VignetteSplines::MeanOfCoarse() const {
  const cv::Mat& v = model_.Attenuation();
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(coarse_.Coefficients());
  for (int y = 0; y < v.rows; ++y) {
    for (int x = 0; x < v.cols; ++x) {
      const ImageSpline::Basis basis = CoarseAt(x, y);
      for (size_t k = 0; k < ImageSpline::kSupport; ++k) mean[basis.index[k]] += basis.weight[k];
    }
  }
  return mean / static_cast<double>(v.total());
}

Eigen::MatrixXd VignetteSplines::CoarseCovariance(const CoarseSystem& system) const {
  const Eigen::Index nv = coarse_.Coefficients(), n = system.b.size();
  const auto columns =
      static_cast<Eigen::Index>(static_cast<size_t>(model_.Grid().columns) / kBlockCells + 1);
  const BlockScatter zero{Eigen::MatrixXd::Zero(n, n), Eigen::MatrixXd::Zero(n, columns)};
  BlockScatter all = model_.SumSamples(
      zero, [&](const Cell& cell, const WallSample& s, const Expected& at, BlockScatter* sum) {
        if (sum->row != cell.row / kBlockCells) sum->FinishRow();
        sum->row = cell.row / kBlockCells;
        auto score = sum->blocks.col(static_cast<Eigen::Index>(cell.column / kBlockCells));
        const ImageSpline::Basis basis = CoarseAt(s.x, s.y);
        const double value = at.weight * at.residual;
        for (size_t k = 0; k < ImageSpline::kSupport; ++k) {
          score[basis.index[k]] += value * basis.weight[k];
        }
        score[nv + s.view] += value;
      });
  all.FinishRow();
  all.M *= all.count / std::max(all.count - static_cast<double>(n), 1.0);  // degrees of freedom
  all.M.diagonal().tail(n - nv).array() += 1 / Square(GainSigma());        // the prior's
  const Eigen::MatrixXd inverse = Inverse(system.S);
  return inverse * all.M * inverse;
}

VignetteSplines::PixelSums VignetteSplines::SumPixels() const {
  const cv::Mat& v = model_.Attenuation();
  return model_.SumSamples(
      PixelSums(PixelSums::Zero(2, static_cast<Eigen::Index>(v.total()))),
      [&](const Cell&, const WallSample& s, const Expected& at, PixelSums* sum) {
        const double value = at.residual + Interpolate(v, s.x, s.y);
        sum->col(cvRound(s.y) * v.cols + cvRound(s.x)) +=
            Eigen::Array2d(at.weight, at.weight * value);
      });
}

SplineFit VignetteSplines::MakeFineFit() const {
  const PixelSums sums = SumPixels();
  const WallProjector& projector = model_.Projector();
  const int columns = model_.Attenuation().cols;
  SplineFit fit(fine_);
  for (int i = 0; i < sums.cols(); ++i) {
    const double x = projector.Enlarge(i % columns), y = projector.Enlarge(i / columns);
    if (sums(0, i) > 0) fit.Add(x, y, sums(1, i) / sums(0, i), sums(0, i));
  }
  return fit;
}

// Neighbouring samples have errors in common, or opposite ones, where the wall's texture is finer
// than a pixel. Variance of what is left of blocks of half of a cell of the spline, of all views
// together, / that of independent noise: larger blocks follow the spline.
double VignetteSplines::NoiseOfAllViews() const {
  const PixelSums sums = SumPixels();
  const cv::Mat& v = model_.Attenuation();
  const double side = longer_ / fine_.Columns() / 2;  // px, about half a cell
  const int block = std::max(1, static_cast<int>(std::lround(side / model_.Wall().reduction)));
  double chi_square = 0, blocks = 0;
  for (int top = 0; top < v.rows; top += block) {
    for (int left = 0; left < v.cols; left += block) {
      double weight = 0, sum = 0;
      for (int y = top; y < std::min(top + block, v.rows); ++y) {
        for (int x = left; x < std::min(left + block, v.cols); ++x) {
          const int i = y * v.cols + x;
          weight += sums(0, i);
          sum += sums(1, i) - sums(0, i) * v.at<float>(y, x);
        }
      }
      if (!(weight > 0)) continue;
      chi_square += sum * sum / weight;
      blocks += 1;
    }
  }
  return chi_square / std::max(blocks - fine_.Coefficients(), 1.0);
}

// The same of single views, of which the spline follows none: in blocks as large as what one
// coefficient has an effect on, by reduced pixel.
cv::Mat VignetteSplines::NoiseOfSingleViews() const {
  constexpr int kCells = 4;  // of a cubic B-spline's support
  const cv::Size whole = model_.Attenuation().size();
  const double side = kCells * longer_ / (fine_.Columns() - 3) / model_.Wall().reduction;
  const cv::Size size(static_cast<int>(std::ceil(whole.width / side)),
                      static_cast<int>(std::ceil(whole.height / side)));
  const Eigen::Index views = model_.Gains().size();
  using Sums = Eigen::Array2Xd;  // of each block, then view
  const Sums sums = model_.SumSamples(
      Sums(Sums::Zero(2, size.area() * views)),
      [&](const Cell&, const WallSample& s, const Expected& at, Sums* sum) {
        const int block = static_cast<int>(s.y / side) * size.width + static_cast<int>(s.x / side);
        sum->col(block * views + s.view) += Eigen::Array2d(at.weight, at.weight * at.residual);
      });
  cv::Mat ratio = MakeImage(size, 1, [&](int x, int y) {
    const auto block = sums.middleCols((y * size.width + x) * views, views);
    const double weight = block.row(0).sum();
    return weight > 0 ? block.row(1).square().sum() / weight : 0;
  });
  cv::resize(ratio, ratio, whole, 0, 0, cv::INTER_LINEAR);
  return ratio;
}

cv::Mat VignetteSplines::FineAttenuation() const {
  return MakeAttenuation(
      fine_, fine_coefficients_, model_.Wall().camera->image_size, model_.Threads());
}

// Variance of the coarse spline, and what that of the fine one with wall and gains known is larger
// by.
cv::Mat VignetteSplines::FineSigma(const CoarseSystem& system,
                                   const Eigen::MatrixXd& coarse) const {
  const Eigen::MatrixXd fine_covariance = MakeFineFit().Covariance();
  const Eigen::MatrixXd known = Inverse(system.known);
  const cv::Mat common_noise = cv::max(NoiseOfSingleViews(), NoiseOfAllViews());
  const WallProjector& projector = model_.Projector();
  cv::Mat sigma = MakeImage(common_noise.size(), model_.Threads(), [&](int x, int y) {
    const ImageSpline::Basis basis = CoarseAt(x, y);
    const double fine =
        VarianceAt(fine_.At(projector.Enlarge(x), projector.Enlarge(y)), fine_covariance) -
        VarianceAt(basis, known);
    return std::sqrt(common_noise.at<float>(y, x) * std::max(fine, 0.0) +
                     VarianceAt(basis, coarse));
  });
  const ImageSize& size = model_.Wall().camera->image_size;
  cv::resize(sigma, sigma, {size[0], size[1]}, 0, 0, cv::INTER_LINEAR);
  return sigma;
}

}  // namespace plenocal
