// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/vignette_fit.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <opencv2/imgproc.hpp>

#include "apps/photometry/image_spline.h"
#include "apps/photometry/wall_samples.h"
#include "calib/base/error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/parallel.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr float kNoBrightness = std::numeric_limits<float>::quiet_NaN();
constexpr double kGainSigma = 0.02;  // of exposures that are known, as shutters and lamps have it
constexpr double kUnknownGain = 3;   // ln units: any
constexpr double kCoarseCells = 8;   // of the spline, along the longer side
constexpr size_t kParts = 16;        // of the work, each with sums of its own
// Width of Tukey's weight, in standard deviations: specular spots lie beyond.
constexpr double kTukeyWidth = 6;
// Smallest effective number of samples per pixel: of samples far apart, each the mean of up to four
// pixels, the mean variance is (2/3)^2 of a pixel's.
constexpr double kLeastDensity = 4.0 / 9;

double Square(double x) { return x * x; }

// Normal equations of the coarse unknowns: coefficients of v, then gains.
struct CoarseSystem {
  Eigen::MatrixXd S;      // the brightness of the wall eliminated
  Eigen::MatrixXd known;  // of v alone, as if wall and gains were known
  Eigen::VectorXd b;
};

class VignetteSolver {
 public:
  VignetteSolver(WallRecording wall, const std::string& where, int threads)
      : wall_(std::move(wall)),
        threads_(threads),
        grid_(ChooseGrid(wall_, where)),
        projector_(wall_),
        fine_(MakeAttenuationSpline(wall_.camera->image_size)),
        coarse_(wall_.camera->image_size, Longer() / kCoarseCells),
        gains_(wall_.views.size(), 0.0),
        v_(wall_.views[0].light.size(), CV_32F, cv::Scalar(0)) {
    noise_gain_ = 255.0 / 1e4;  // as most sensors; estimated from the residuals
    TabulateNoise();
    Sample();
  }

  void Sample() {
    rows_ = SampleWall(wall_, grid_, threads_);
    c_.assign(rows_.size(), std::vector<float>(static_cast<size_t>(grid_.columns), kNoBrightness));
  }

  [[nodiscard]] size_t Measurements() const {
    size_t count = 0;
    for (const WallRow& row : rows_) count += row.samples.size();
    return count;
  }

  /// One round: gains and coarse v with the wall, then fine v.
  void Round() {
    EstimateWall();
    const CoarseSystem system = MakeCoarseSystem({});
    ApplyCoarse(SolveCoarse(system));
    EstimateWall();
    FitFine();
  }

  // Variance of a pixel's light as a straight line of the light, from residuals; weights are robust
  // from then on.
  void EstimateNoise() {
    EstimateWall();
    constexpr size_t kBins = 64;
    struct Sums {
      std::array<double, kBins> weight{}, square{}, light{};
    };
    std::vector<Sums> parts(kParts);
    ForSamples([&](const SamplePlace& place, const WallSample& s, double residual, double freedom) {
      const double spread = LogVariance(s.light) * Mixing(s) * freedom;
      const double robust = TukeyWeight(Square(residual) / (Square(kTukeyWidth) * spread));
      if (!robust_ || robust > 0) {
        Sums& sums = parts[place.part];
        const auto bin = std::min(static_cast<size_t>(s.light / 256 * kBins), kBins - 1);
        const double w = robust_ ? robust : 1;
        sums.weight[bin] += w;
        sums.light[bin] += w * s.light;
        sums.square[bin] += w * Square(residual) / spread;
      }
    });
    // Ratio of what is measured to what was assumed, by light.
    Sums all;
    for (const Sums& part : parts) {
      for (size_t i = 0; i < kBins; ++i) {
        all.weight[i] += part.weight[i];
        all.square[i] += part.square[i];
        all.light[i] += part.light[i];
      }
    }
    double n00 = 0, n01 = 0, n11 = 0, b0 = 0, b1 = 0;
    for (size_t i = 0; i < kBins; ++i) {
      if (all.weight[i] < 100) continue;
      const double u = all.light[i] / all.weight[i];
      const double assumed = noise_gain_ * u + noise_read_ + Rounding(u);
      const double variance = assumed * all.square[i] / all.weight[i] - Rounding(u);
      const double w = all.weight[i] / Square(assumed);
      n00 += w * u * u;
      n01 += w * u;
      n11 += w;
      b0 += w * u * variance;
      b1 += w * variance;
    }
    const double determinant = n00 * n11 - n01 * n01;
    const double gain = determinant > 0 ? (n11 * b0 - n01 * b1) / determinant : 0;
    const double read = determinant > 0 ? (n00 * b1 - n01 * b0) / determinant : 0;
    noise_gain_ = read > 0 && gain > 0 ? gain : std::max(b0 / n00, 1e-6);
    noise_read_ = gain > 0 ? std::max(read, 0.0) : 0;
    robust_ = true;
    TabulateNoise();
  }

  // Poses by the wall's texture: those from the marker are uncertain far from it.
  void RefinePoses() {
    ParallelFor(wall_.views.size(), threads_, [&](size_t v) { RefinePose(v); });
    Sample();
  }

  [[nodiscard]] VignetteEstimate Result() {
    EstimateWall();
    VignetteEstimate result;
    const CoarseSystem system = MakeCoarseSystem({});
    SetAttenuation(system, &result);
    SetWall(&result);
    for (const double gain : gains_) result.gains.push_back(std::exp(gain));
    SetResiduals(&result);
    result.shading = TestShading();
    return result;
  }

 private:
  [[nodiscard]] double Longer() const {
    return std::max(wall_.camera->image_size[0], wall_.camera->image_size[1]);
  }

  // ---- noise

  // Variance of rounding to grey values, of one pixel's light.
  [[nodiscard]] double Rounding(double light) const {
    const ResponseCurve::Table& values = wall_.response.Values();
    const auto above = std::ranges::upper_bound(values, light);
    const auto k = std::clamp<size_t>(
        static_cast<size_t>(above - values.begin()), 1, ResponseCurve::kValues - 1);
    return Square(values[k] - values[k - 1]) / 12;
  }
  void TabulateNoise() {
    for (size_t i = 0; i < log_variances_.size(); ++i) {
      const double light =
          256 * (static_cast<double>(i) + 0.5) / static_cast<double>(log_variances_.size());
      log_variances_[i] = static_cast<float>((noise_gain_ * light + noise_read_ + Rounding(light)) /
                                             Square(light * wall_.reduction));
    }
  }
  // Of the logarithm of a reduced pixel's light.
  [[nodiscard]] double LogVariance(float light) const {
    const auto i = static_cast<size_t>(light / 256 * static_cast<float>(log_variances_.size()));
    return log_variances_[std::min(i, log_variances_.size() - 1)];
  }
  // Of a value between four pixels, by that of one.
  [[nodiscard]] static double Mixing(const WallSample& s) {
    const double fx = s.x - std::floor(s.x), fy = s.y - std::floor(s.y);
    return (fx * fx + (1 - fx) * (1 - fx)) * (fy * fy + (1 - fy) * (1 - fy));
  }
  // Inverse of the variance that a sample has in effect, where neighbours share their noise.
  [[nodiscard]] double Weight(const WallSample& s, double residual) const {
    const double variance = LogVariance(s.light);
    const double weight = 1 / (variance * std::max<double>(s.density, kLeastDensity));
    if (!robust_) return weight;
    return weight * TukeyWeight(Square(residual) / (Square(kTukeyWidth) * variance * Mixing(s)));
  }

  // ---- the wall

  [[nodiscard]] double Predicted(const WallSample& s) const {
    return gains_[s.view] + Interpolate(v_, s.x, s.y);
  }

  void EstimateWall() {
    ParallelFor(rows_.size(), threads_, [&](size_t r) {
      const WallRow& row = rows_[r];
      for (size_t cell = 0; cell + 1 < row.begin.size(); ++cell) {
        float& c = c_[r][cell];
        double sum = 0, weight = 0;
        for (size_t i = row.begin[cell]; i < row.begin[cell + 1]; ++i) {
          const WallSample& s = row.samples[i];
          const double y = s.brightness - Predicted(s);
          const double w = Weight(s, std::isnan(c) ? 0 : y - c);
          sum += w * y;
          weight += w;
        }
        c = weight > 0 ? static_cast<float>(sum / weight) : kNoBrightness;
      }
    });
  }

  // Where a sample is, and the part of the work that has it.
  struct SamplePlace {
    size_t part, row, column;
  };
  // Calls body(place, sample, residual, share of its variance that the residual has) for all
  // samples of cells that have a brightness.
  template <typename Body>
  void ForSamples(const Body& body) const {
    ParallelFor(kParts, threads_, [&](size_t part) {
      for (size_t r = part; r < rows_.size(); r += kParts) {
        const WallRow& row = rows_[r];
        for (size_t cell = 0; cell + 1 < row.begin.size(); ++cell) {
          const float c = c_[r][cell];
          if (std::isnan(c)) continue;
          double total = 0;
          for (size_t i = row.begin[cell]; i < row.begin[cell + 1]; ++i) {
            const WallSample& s = row.samples[i];
            total += Weight(s, s.brightness - Predicted(s) - c);
          }
          for (size_t i = row.begin[cell]; i < row.begin[cell + 1]; ++i) {
            const WallSample& s = row.samples[i];
            const double residual = s.brightness - Predicted(s) - c;
            body(SamplePlace{part, r, cell},
                 s,
                 residual,
                 std::max(1 - Weight(s, residual) / total, 0.1));
          }
        }
      }
    });
  }

  // ---- coarse v and gains

  // Of the views in `only`, or of all.
  [[nodiscard]] CoarseSystem MakeCoarseSystem(const std::vector<bool>& only) const {
    const Eigen::Index nv = coarse_.Coefficients();
    const Eigen::Index n = nv + static_cast<Eigen::Index>(gains_.size());
    // The work grows with the square of the unknowns; thinned cells are as good a sample.
    constexpr double kMostWork = 4e10;
    const double work =
        static_cast<double>(grid_.rows) * grid_.columns * static_cast<double>(n * n);
    const auto step = static_cast<size_t>(std::max(1.0, std::ceil(work / kMostWork)));
    std::vector<CoarseSystem> parts(kParts);
    ParallelFor(kParts, threads_, [&](size_t part) {
      CoarseSystem& sum = parts[part];
      sum.S = Eigen::MatrixXd::Zero(n, n);
      sum.known = Eigen::MatrixXd::Zero(nv, nv);
      sum.b = Eigen::VectorXd::Zero(n);
      constexpr Eigen::Index kBatch = 128;
      Eigen::MatrixXd batch = Eigen::MatrixXd::Zero(n, kBatch);
      Eigen::VectorXd batch_b(kBatch);
      Eigen::Index filled = 0;
      const auto flush = [&] {
        if (filled == 0) return;
        sum.S.selfadjointView<Eigen::Lower>().rankUpdate(batch.leftCols(filled), -1.0);
        sum.b.noalias() -= batch.leftCols(filled) * batch_b.head(filled);
        batch.leftCols(filled).setZero();
        filled = 0;
      };
      for (size_t r = part; r < rows_.size(); r += kParts) {
        const WallRow& row = rows_[r];
        for (size_t cell = r % step; cell + 1 < row.begin.size(); cell += step) {
          if (std::isnan(c_[r][cell])) continue;
          double total = 0, total_b = 0;
          auto column = batch.col(filled);
          for (size_t i = row.begin[cell]; i < row.begin[cell + 1]; ++i) {
            const WallSample& s = row.samples[i];
            if (!only.empty() && !only[s.view]) continue;
            const double residual = s.brightness - Predicted(s) - c_[r][cell];
            const double w = Weight(s, residual);
            if (!(w > 0)) continue;
            const ImageSpline::Basis basis =
                coarse_.At(projector_.Enlarge(s.x), projector_.Enlarge(s.y));
            const Eigen::Index g = nv + s.view;
            for (size_t a = 0; a < ImageSpline::kSupport; ++a) {
              const double wa = w * basis.weight[a];
              const Eigen::Index ia = basis.index[a];
              for (size_t b = 0; b <= a; ++b) sum.known(ia, basis.index[b]) += wa * basis.weight[b];
              sum.S(g, ia) += wa;
              sum.b[ia] += wa * residual;
              column[ia] += wa;
            }
            sum.S(g, g) += w;
            sum.b[g] += w * residual;
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
      sum.S.topLeftCorner(nv, nv) += sum.known;
    });
    CoarseSystem system = std::move(parts[0]);
    for (size_t part = 1; part < kParts; ++part) {
      system.S += parts[part].S;
      system.known += parts[part].known;
      system.b += parts[part].b;
    }
    system.S *= static_cast<double>(step);
    system.known *= static_cast<double>(step);
    system.b *= static_cast<double>(step);
    system.S = system.S.selfadjointView<Eigen::Lower>();
    system.known = system.known.selfadjointView<Eigen::Lower>();
    AddPriors(&system);
    return system;
  }

  // Gains about 1; mean of v 0, for a factor of it is one of the wall; and hardly any bend where
  // there are no data.
  void AddPriors(CoarseSystem* system) const {
    const Eigen::Index nv = coarse_.Coefficients();
    const double sigma = wall_.exposures_known ? kGainSigma : kUnknownGain;
    for (size_t i = 0; i < gains_.size(); ++i) {
      const Eigen::Index at = nv + static_cast<Eigen::Index>(i);
      system->S(at, at) += 1 / Square(sigma);
      system->b[at] -= gains_[i] / Square(sigma);
    }
    const double scale = system->known.diagonal().mean();
    const Eigen::VectorXd mean = MeanOfCoarse();
    system->S.topLeftCorner(nv, nv) += scale * static_cast<double>(nv) * mean * mean.transpose();
    constexpr double kHardly = 1e-6;
    system->S.topLeftCorner(nv, nv).diagonal().array() += kHardly * scale;
    system->known.diagonal().array() += kHardly * scale;
  }

  // v's mean over the image = its product with the coefficients.
  [[nodiscard]] Eigen::VectorXd MeanOfCoarse() const {
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(coarse_.Coefficients());
    for (int y = 0; y < v_.rows; ++y) {
      for (int x = 0; x < v_.cols; ++x) {
        const ImageSpline::Basis basis = coarse_.At(projector_.Enlarge(x), projector_.Enlarge(y));
        for (size_t k = 0; k < ImageSpline::kSupport; ++k) mean[basis.index[k]] += basis.weight[k];
      }
    }
    return mean / static_cast<double>(v_.total());
  }

  [[nodiscard]] static Eigen::VectorXd SolveCoarse(const CoarseSystem& system) {
    return SolveSymmetric(system.S, system.b);
  }

  void ApplyCoarse(const Eigen::VectorXd& step) {
    const Eigen::VectorXd coefficients = step.head(coarse_.Coefficients());
    for (int y = 0; y < v_.rows; ++y) {
      for (int x = 0; x < v_.cols; ++x) {
        v_.at<float>(y, x) += static_cast<float>(
            coarse_.Evaluate(coefficients, projector_.Enlarge(x), projector_.Enlarge(y)));
      }
    }
    for (size_t i = 0; i < gains_.size(); ++i) {
      gains_[i] += step[coarse_.Coefficients() + static_cast<Eigen::Index>(i)];
    }
  }

  // ---- fine v

  // Information and mean of y - g - c by reduced pixel.
  struct PixelSums {
    cv::Mat weight, value;  // CV_64F
  };
  [[nodiscard]] PixelSums SumPixels() const {
    std::vector<PixelSums> parts(kParts);
    for (PixelSums& part : parts) {
      part.weight = cv::Mat::zeros(v_.size(), CV_64F);
      part.value = cv::Mat::zeros(v_.size(), CV_64F);
    }
    ForSamples([&](const SamplePlace& place, const WallSample& s, double residual, double) {
      const double w = Weight(s, residual);
      const double value = residual + Interpolate(v_, s.x, s.y);
      const int x = cvRound(s.x), y = cvRound(s.y);
      parts[place.part].weight.at<double>(y, x) += w;
      parts[place.part].value.at<double>(y, x) += w * value;
    });
    for (size_t part = 1; part < kParts; ++part) {
      parts[0].weight += parts[part].weight;
      parts[0].value += parts[part].value;
    }
    return parts[0];
  }

  [[nodiscard]] SplineFit MakeFineFit() const {
    const PixelSums sums = SumPixels();
    SplineFit fit(fine_);
    for (int y = 0; y < v_.rows; ++y) {
      for (int x = 0; x < v_.cols; ++x) {
        const double w = sums.weight.at<double>(y, x);
        if (!(w > 0)) continue;
        fit.Add(projector_.Enlarge(x), projector_.Enlarge(y), sums.value.at<double>(y, x) / w, w);
      }
    }
    return fit;
  }

  // Neighbouring samples have errors in common, or opposite ones, where the wall's texture is finer
  // than a pixel. Variance of what is left of blocks of half of a cell of the spline, of all views
  // together, / that of independent noise: larger blocks follow the spline.
  [[nodiscard]] double NoiseOfAllViews() const {
    const PixelSums sums = SumPixels();
    const double side = Longer() / fine_.Columns() / 2;  // px, about half a cell
    const int block = std::max(1, static_cast<int>(std::lround(side / wall_.reduction)));
    double chi_square = 0, blocks = 0;
    for (int y = 0; y < v_.rows; y += block) {
      for (int x = 0; x < v_.cols; x += block) {
        const cv::Rect part = cv::Rect(x, y, block, block) & cv::Rect(0, 0, v_.cols, v_.rows);
        cv::Mat v;
        v_(part).convertTo(v, CV_64F);
        const double weight = cv::sum(sums.weight(part))[0];
        if (!(weight > 0)) continue;
        const double sum = cv::sum(sums.value(part))[0] - sums.weight(part).dot(v);
        chi_square += sum * sum / weight;
        blocks += 1;
      }
    }
    return chi_square / std::max(blocks - fine_.Coefficients(), 1.0);
  }

  // The same of single views, of which the spline follows none: in blocks as large as what one
  // coefficient has an effect on, by reduced pixel.
  [[nodiscard]] cv::Mat NoiseOfSingleViews() const {
    constexpr int kCells = 4;  // of a cubic B-spline's support
    const double side = kCells * Longer() / (fine_.Columns() - 3) / wall_.reduction;
    const cv::Size size(static_cast<int>(std::ceil(v_.cols / side)),
                        static_cast<int>(std::ceil(v_.rows / side)));
    struct Sums {
      Eigen::MatrixXd weight, value;  // blocks x views
    };
    const Eigen::MatrixXd zero =
        Eigen::MatrixXd::Zero(size.area(), static_cast<Eigen::Index>(gains_.size()));
    std::vector<Sums> parts(kParts, {zero, zero});
    ForSamples([&](const SamplePlace& place, const WallSample& s, double residual, double) {
      const int block = static_cast<int>(s.y / side) * size.width + static_cast<int>(s.x / side);
      const double w = Weight(s, residual);
      parts[place.part].weight(block, s.view) += w;
      parts[place.part].value(block, s.view) += w * residual;
    });
    for (size_t part = 1; part < kParts; ++part) {
      parts[0].weight += parts[part].weight;
      parts[0].value += parts[part].value;
    }
    cv::Mat ratio(size, CV_32F, cv::Scalar(0));
    for (int block = 0; block < size.area(); ++block) {
      const double weight = parts[0].weight.row(block).sum();
      if (!(weight > 0)) continue;
      ratio.at<float>(block / size.width, block % size.width) =
          static_cast<float>(parts[0].value.row(block).squaredNorm() / weight);
    }
    cv::resize(ratio, ratio, v_.size(), 0, 0, cv::INTER_LINEAR);
    return ratio;
  }

  void FitFine() {
    fine_coefficients_ = MakeFineFit().Solve();
    for (int y = 0; y < v_.rows; ++y) {
      for (int x = 0; x < v_.cols; ++x) {
        v_.at<float>(y, x) = static_cast<float>(
            fine_.Evaluate(fine_coefficients_, projector_.Enlarge(x), projector_.Enlarge(y)));
      }
    }
  }

  // ---- poses

  void RefinePose(size_t v) {
    constexpr int kEvery = 3;  // cells, in both directions
    WallView& view = wall_.views[v];
    const CalibratedCamera& camera = *wall_.camera;
    Matrix6d N = Matrix6d::Zero();
    Vector6d b = Vector6d::Zero();
    for (int r = 0; r < grid_.rows; r += kEvery) {
      for (int column = 0; column < grid_.columns; column += kEvery) {
        const float c = c_[static_cast<size_t>(r)][static_cast<size_t>(column)];
        if (std::isnan(c)) continue;
        const Eigen::Vector3d point = grid_.At(column, r);
        WallProjection seen;
        if (!projector_(view, point, &seen)) continue;
        const float y = Interpolate(view.brightness, seen.x, seen.y);
        const float right = Interpolate(view.brightness, seen.x + 0.5, seen.y);
        const float left = Interpolate(view.brightness, seen.x - 0.5, seen.y);
        const float below = Interpolate(view.brightness, seen.x, seen.y + 0.5);
        const float above = Interpolate(view.brightness, seen.x, seen.y - 0.5);
        const double residual = y - gains_[v] - Interpolate(v_, seen.x, seen.y) - c;
        if (!std::isfinite(residual + right - left + below - above)) continue;
        const Eigen::Vector3d p = view.T_camera_wall * point;
        std::array<double, kMaxObservationSize> u{};
        std::array<double, 6> J_point{};
        if (!camera.model->project_with_jacobian(
                camera.params.data(),
                camera.config.data(),
                u.data(),
                p,
                {.predicted = u.data(), .J_point = J_point.data()})) {
          continue;
        }
        const Eigen::RowVector2d gradient =
            Eigen::RowVector2d(right - left, below - above) / wall_.reduction;
        const Eigen::RowVector3d by_point =
            gradient *
            Eigen::Map<const Eigen::Matrix<double, 2, 3, Eigen::RowMajor>>(J_point.data());
        // Retract: R' = Exp(w) R, t' = t + v.
        Vector6d J;
        J << by_point.transpose(), (-by_point * Hat(p - view.T_camera_wall.t)).transpose();
        const double variance = LogVariance(Interpolate(view.light, seen.x, seen.y));
        const double w =
            CauchyWeight(Square(residual) / (kCauchyWidthSquared<> * variance)) / variance;
        N += w * J * J.transpose();
        b -= w * J * residual;
      }
    }
    // What the texture leaves open stays as the marker has it.
    constexpr double kMarkerPosition = 1e-3, kMarkerAngle = 1e-3;  // m, rad
    N.diagonal().head<3>().array() += 1 / Square(kMarkerPosition);
    N.diagonal().tail<3>().array() += 1 / Square(kMarkerAngle);
    view.T_camera_wall = Retract(view.T_camera_wall, SolveSymmetric(N, b));
  }

  // ---- results

  void SetAttenuation(const CoarseSystem& system, VignetteEstimate* result) {
    const ImageSize& size = wall_.camera->image_size;
    cv::Mat v(size[1], size[0], CV_32F);
    ParallelFor(static_cast<size_t>(size[1]), threads_, [&](size_t y) {
      for (int x = 0; x < size[0]; ++x) {
        v.at<float>(static_cast<int>(y), x) =
            static_cast<float>(fine_.Evaluate(fine_coefficients_, x, static_cast<double>(y)));
      }
    });
    double largest = 0;
    cv::minMaxLoc(v, nullptr, &largest);
    cv::exp(v - largest, result->attenuation);

    // Variance of the fine spline with wall and gains known, and what it is larger by because they
    // are not, which the coarse system has.
    const Eigen::Index nv = coarse_.Coefficients();
    const Eigen::MatrixXd fine_covariance = MakeFineFit().Covariance();
    const Eigen::MatrixXd all = Inverse(system.S);
    const Eigen::MatrixXd covariance = all.topLeftCorner(nv, nv);
    for (Eigen::Index i = nv; i < all.rows(); ++i) {
      result->gain_sigma.push_back(std::sqrt(all(i, i)));
    }
    const Eigen::MatrixXd excess = covariance - Inverse(system.known);
    const cv::Mat common_noise = cv::max(NoiseOfSingleViews(), NoiseOfAllViews());
    cv::Mat sigma(v_.size(), CV_32F);
    ParallelFor(static_cast<size_t>(v_.rows), threads_, [&](size_t row) {
      const int y = static_cast<int>(row);
      for (int x = 0; x < v_.cols; ++x) {
        const double px = projector_.Enlarge(x), py = projector_.Enlarge(y);
        const double variance = VarianceAt(fine_.At(px, py), fine_covariance) +
                                std::max(VarianceAt(coarse_.At(px, py), excess), 0.0);
        sigma.at<float>(y, x) =
            static_cast<float>(std::sqrt(common_noise.at<float>(y, x) * variance));
      }
    });
    cv::resize(sigma, result->sigma, {size[0], size[1]}, 0, 0, cv::INTER_LINEAR);
    FindOpenModes(covariance, result);
  }

  // Modes of v over the image with a standard deviation above half a percent.
  void FindOpenModes(const Eigen::MatrixXd& covariance, VignetteEstimate* result) const {
    constexpr int kColumns = 12, kRows = 9;
    constexpr double kOpen = 0.005;
    constexpr Eigen::Index kPlaces = kColumns * kRows;
    Eigen::MatrixXd B = Eigen::MatrixXd::Zero(kPlaces, covariance.rows());
    Eigen::MatrixXd shapes(kPlaces, 3);
    for (int j = 0; j < kRows; ++j) {
      for (int i = 0; i < kColumns; ++i) {
        const double x = (i + 0.5) / kColumns, y = (j + 0.5) / kRows;
        const Eigen::Index at = j * kColumns + i;
        const ImageSpline::Basis basis = coarse_.At(x * wall_.camera->image_size[0] - 0.5,
                                                    y * wall_.camera->image_size[1] - 0.5);
        for (size_t k = 0; k < ImageSpline::kSupport; ++k) B(at, basis.index[k]) = basis.weight[k];
        shapes.row(at) << x - 0.5, y - 0.5, Square(x - 0.5) + Square(y - 0.5) - 1.0 / 6;
      }
    }
    const SymmetricEigen modes =
        DecomposeSymmetric(Eigen::MatrixXd(B * covariance * B.transpose()));
    for (Eigen::Index m = kPlaces - 1; m >= 0; --m) {
      const double sigma = std::sqrt(std::max(modes.values[m], 0.0) / kPlaces);
      if (sigma < kOpen) break;
      static constexpr std::array<const char*, 3> kNames{
          "a tilt along x", "a tilt along y", "a fall-off towards the border"};
      Eigen::Index best = 0;
      const Eigen::VectorXd likeness = (shapes.transpose() * modes.vectors.col(m)).array().abs() /
                                       shapes.colwise().norm().transpose().array();
      likeness.maxCoeff(&best);
      constexpr double kAlike = 0.7;
      result->open.push_back(
          {likeness[best] > kAlike ? kNames[static_cast<size_t>(best)] : "a slowly varying pattern",
           sigma});
    }
  }

  void SetWall(VignetteEstimate* result) const {
    result->wall.create(grid_.rows, grid_.columns, CV_32F);
    float largest = 0;
    for (int r = 0; r < grid_.rows; ++r) {
      for (int column = 0; column < grid_.columns; ++column) {
        const float c = c_[static_cast<size_t>(r)][static_cast<size_t>(column)];
        const float brightness = std::isnan(c) ? c : std::exp(c);
        result->wall.at<float>(r, column) = brightness;
        if (brightness > largest) largest = brightness;
      }
    }
    result->wall /= largest;
    result->wall_cell = grid_.cell;
  }

  void SetResiduals(VignetteEstimate* result) const {
    // Angles of the views at the samples, in bins; their fifths are found from these.
    constexpr size_t kBins = 180;
    struct Sums {
      std::array<double, kBins> weight{}, residual{};
      double squares = 0, spread = 0, robust = 0, outliers = 0, count = 0;
    };
    std::vector<Sums> parts(kParts);
    ForSamples([&](const SamplePlace& place, const WallSample& s, double residual, double freedom) {
      Sums& sums = parts[place.part];
      const RigidTransform& T = wall_.views[s.view].T_camera_wall;
      const Eigen::Vector3d p =
          T * grid_.At(static_cast<int>(place.column), static_cast<int>(place.row));
      const double cosine = std::min(std::abs(T.R.col(2).dot(p)) / p.norm(), 1.0);
      const auto bin = static_cast<size_t>(std::acos(cosine) / std::numbers::pi * 2 * (kBins - 1));
      const double w = Weight(s, residual);
      sums.weight[bin] += w;
      sums.residual[bin] += w * residual;
      const double spread = LogVariance(s.light) * Mixing(s) * freedom;
      sums.count += 1;
      constexpr double kBeyond = 3;
      if (Square(residual) > Square(kBeyond) * spread) sums.outliers += 1;
      const double robust = TukeyWeight(Square(residual) / (Square(kTukeyWidth) * spread));
      sums.robust += robust;
      sums.squares += robust * Square(residual);
      sums.spread += robust * spread;
    });
    Sums all;
    for (const Sums& part : parts) {
      for (size_t i = 0; i < kBins; ++i) {
        all.weight[i] += part.weight[i];
        all.residual[i] += part.residual[i];
      }
      all.squares += part.squares;
      all.spread += part.spread;
      all.robust += part.robust;
      all.outliers += part.outliers;
      all.count += part.count;
    }
    result->unevenness = Unevenness();
    result->residual = std::sqrt(all.squares / all.robust);
    result->expected = std::sqrt(all.spread / all.robust);
    result->outliers = all.outliers / all.count;
    result->measurements = static_cast<size_t>(all.count);
    const double total = std::accumulate(all.weight.begin(), all.weight.end(), 0.0);
    double passed = 0, residual = 0, weight = 0;
    size_t fifth = 0;
    for (size_t i = 0; i < kBins; ++i) {
      passed += all.weight[i];
      weight += all.weight[i];
      residual += all.residual[i];
      const double angle = (static_cast<double>(i) + 1) * std::numbers::pi / 2 / (kBins - 1);
      while (fifth < 5 && passed >= total * (static_cast<double>(fifth) + 1) / 5 * (1 - 1e-12)) {
        result->by_angle[fifth] = weight > 0 ? residual / weight : 0;
        result->angle_limits[++fifth] = angle;
        weight = residual = 0;
      }
    }
  }

  [[nodiscard]] double Unevenness() const {
    // Fewer residuals have a variance that scatters by itself.
    constexpr size_t kFewest = 10;
    std::vector<double> variances;
    for (size_t r = 0; r < rows_.size(); ++r) {
      const WallRow& row = rows_[r];
      for (size_t cell = 0; cell + 1 < row.begin.size(); ++cell) {
        const size_t count = row.begin[cell + 1] - row.begin[cell];
        if (count < kFewest || std::isnan(c_[r][cell])) continue;
        double sum = 0;
        for (size_t i = row.begin[cell]; i < row.begin[cell + 1]; ++i) {
          const WallSample& s = row.samples[i];
          sum += Square(s.brightness - Predicted(s) - c_[r][cell]) /
                 (LogVariance(s.light) * Mixing(s));
        }
        variances.push_back(sum / static_cast<double>(count - 1));
      }
    }
    if (variances.empty()) return 0;
    return Quantile(&variances, 0.9) / Quantile(&variances, 0.2);
  }

  // Views with a roll near that of most, and those turned by 90 or 180 degrees, must find the same
  // v: light that goes with the camera does not turn with it.
  [[nodiscard]] ShadingTest TestShading() const {
    std::vector<double> rolls;
    for (const WallView& view : wall_.views) {
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
      turned.push_back(!near(roll, usual) &&
                       std::abs(std::remainder(roll - usual, 2 * std::numbers::pi)) > 2 * kWidth);
    }
    constexpr std::ptrdiff_t kFewest = 8;
    ShadingTest test;
    if (std::ranges::count(upright, true) < kFewest || std::ranges::count(turned, true) < kFewest) {
      return test;
    }
    test.tested = true;
    const CoarseSystem a = MakeCoarseSystem(upright), b = MakeCoarseSystem(turned);
    const Eigen::Index nv = coarse_.Coefficients();
    const Eigen::VectorXd difference = SolveCoarse(a).head(nv) - SolveCoarse(b).head(nv);
    const Eigen::MatrixXd covariance =
        Inverse(a.S).topLeftCorner(nv, nv) + Inverse(b.S).topLeftCorner(nv, nv);
    // Tilts and the second order, by least squares over the image.
    constexpr int kSide = 8, kTerms = 5;
    Eigen::MatrixXd B = Eigen::MatrixXd::Zero(kSide * kSide, nv), P(kSide * kSide, kTerms + 1);
    for (int j = 0; j < kSide; ++j) {
      for (int i = 0; i < kSide; ++i) {
        const double x = (i + 0.5) / kSide - 0.5, y = (j + 0.5) / kSide - 0.5;
        const Eigen::Index at = j * kSide + i;
        const ImageSpline::Basis basis = coarse_.At((x + 0.5) * wall_.camera->image_size[0] - 0.5,
                                                    (y + 0.5) * wall_.camera->image_size[1] - 0.5);
        for (size_t k = 0; k < ImageSpline::kSupport; ++k) B(at, basis.index[k]) = basis.weight[k];
        P.row(at) << x, y, x * x, x * y, y * y, 1;
      }
    }
    const Eigen::MatrixXd fit = PseudoInverse(P).topRows(kTerms) * B;
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

  WallRecording wall_;
  int threads_;
  WallGrid grid_;
  WallProjector projector_;
  ImageSpline fine_, coarse_;
  std::vector<double> gains_;  // logarithms
  cv::Mat v_;                  // of the reduced image
  Eigen::VectorXd fine_coefficients_;
  std::vector<WallRow> rows_;
  std::vector<std::vector<float>> c_;       // by row and column of the grid
  double noise_gain_ = 0, noise_read_ = 0;  // variance of a pixel's light: gain * light + read
  std::array<float, 1024> log_variances_{};
  bool robust_ = false;
};

}  // namespace

VignetteEstimate FitVignette(WallRecording wall,
                             const std::string& where,
                             int threads,
                             const std::function<bool(const std::string& stage)>& progress) {
  const auto report = [&](const char* stage) {
    if (!progress(stage)) throw Stopped();
  };
  report("wall: points in all images");
  VignetteSolver solver(std::move(wall), where, threads);
  constexpr size_t kFewest = 20000;
  if (solver.Measurements() < kFewest) {
    throw Error(
        ErrorKind::kJob,
        fmt::format("{}: the images have only {} measurements of points that at least three "
                    "of them show; move the camera less between images, avoid saturation",
                    where,
                    solver.Measurements()));
  }
  report("wall: first rounds");
  solver.Round();
  solver.Round();
  solver.EstimateNoise();
  for (int i = 0; i < 2; ++i) {
    report("wall: poses by its texture");
    solver.RefinePoses();
    solver.Round();
    solver.EstimateNoise();
  }
  report("wall: last rounds");
  for (int i = 0; i < 3; ++i) solver.Round();
  solver.EstimateNoise();
  solver.Round();
  report("wall: standard deviations");
  return solver.Result();
}

}  // namespace plenocal
