// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/vignette_fit.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <opencv2/imgproc.hpp>

#include "apps/photometry/image_spline.h"
#include "apps/photometry/response/noise_line.h"
#include "apps/photometry/wall_samples.h"
#include "calib/base/format_error.h"
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
// Of the wall, in both directions: far more than what neighbours share their errors over.
constexpr size_t kBlockCells = 8;

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
        used_(Eigen::VectorXd::Ones(static_cast<Eigen::Index>(gains_.size()))),
        v_(wall_.views[0].light.size(), CV_32F, cv::Scalar(0)) {
    noise_gain_ = 255.0 / 1e4;  // as most sensors; estimated from the residuals
    TabulateNoise();
    Sample();
  }

  void Sample() {
    rows_ = SampleWall(wall_, grid_, threads_);
    c_.assign(rows_.size(), std::vector<float>(static_cast<size_t>(grid_.columns), kNoBrightness));
    around_ = c_;
    contrast_.assign(c_.size(), std::vector<float>(c_.front().size()));
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
    ForSamples([&](const SamplePlace& place, const WallSample& s, const Expected& at) {
      const double spread = LogVariance(at.light) * Mixing(s) * at.freedom;
      const double robust = TukeyWeight(Square(at.residual) / (Square(kTukeyWidth) * spread));
      if (!robust_ || robust > 0) {
        Sums& sums = parts[place.part];
        const auto bin = std::min(static_cast<size_t>(at.light / 256 * kBins), kBins - 1);
        const double w = robust_ ? robust : 1;
        sums.weight[bin] += w;
        sums.light[bin] += w * at.light;
        sums.square[bin] += w * Square(at.residual) / spread;
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
    NoiseLine line;
    for (size_t i = 0; i < kBins; ++i) {
      if (all.weight[i] < 100) continue;
      const double u = all.light[i] / all.weight[i];
      const double assumed = noise_gain_ * u + noise_read_ + Rounding(u);
      const double variance = assumed * all.square[i] / all.weight[i] - Rounding(u);
      line.Add(all.weight[i] / Square(assumed), u, variance);
    }
    const double gain = line.IsDetermined() ? line.Gain() : 0;
    const double read = line.IsDetermined() ? line.ReadVariance() : 0;
    noise_gain_ = read > 0 && gain > 0 ? gain : std::max(line.GainAlone(), 1e-6);
    noise_read_ = gain > 0 ? std::max(read, 0.0) : 0;
    robust_ = true;
    TabulateNoise();
  }

  // Leaves out the view that fits the others' wall worst at the pose from its marker, if it fits
  // far worse than usual: the tilt of a small marker has a mirrored solution. Before weights are
  // robust, which would hide it.
  bool LeaveOutMisplaced() {
    EstimateWall();
    struct Sums {
      double square = 0, count = 0;
    };
    std::vector<std::vector<Sums>> parts(kParts, std::vector<Sums>(wall_.views.size()));
    ForSamples([&](const SamplePlace& place, const WallSample& s, const Expected& at) {
      parts[place.part][s.view].square +=
          Square(at.residual) /
          (LogVariance(at.light) * Mixing(s) + contrast_[place.row][place.column]);
      parts[place.part][s.view].count += 1;
    });
    std::vector<double> sizes, distances;  // logarithms of the RMS
    for (size_t v = 0; v < wall_.views.size(); ++v) {
      Sums all{.square = 1e-12};
      for (const std::vector<Sums>& part : parts) {
        all.square += part[v].square;
        all.count += part[v].count;
      }
      sizes.push_back(std::log(all.square / std::max(all.count, 1.0)) / 2);
    }
    const double usual = Median(sizes);
    for (const double size : sizes) distances.push_back(std::abs(size - usual));
    constexpr double kFarOff = 5;
    const double limit = std::max(kFarOff * kSigmaPerMad * Median(distances), std::numbers::ln2);
    const auto worst = std::ranges::max_element(sizes);
    if (*worst - usual < limit) return false;
    const auto view = static_cast<size_t>(worst - sizes.begin());
    wall_.views[view].brightness.setTo(kNoBrightness);
    used_[static_cast<Eigen::Index>(view)] = 0;
    Sample();
    return true;
  }

  // Poses by the wall's texture: those from the marker are uncertain far from it.
  void RefinePoses() {
    ParallelFor(wall_.views.size(), threads_, [&](size_t v) { RefinePose(v); });
    Sample();
  }

  [[nodiscard]] VignetteEstimate Result() {
    EstimateWall();
    VignetteEstimate result;
    for (size_t v = 0; v < wall_.views.size(); ++v) {
      if (used_[static_cast<Eigen::Index>(v)] == 0) {
        result.misplaced.push_back(wall_.views[v].frame);
      }
    }
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
  [[nodiscard]] double LogVariance(double light) const {
    const auto i = static_cast<size_t>(light / 256 * static_cast<double>(log_variances_.size()));
    return log_variances_[std::min(i, log_variances_.size() - 1)];
  }
  // Of a value between four pixels, by that of one.
  [[nodiscard]] static double Mixing(const WallSample& s) {
    const double fx = s.x - std::floor(s.x), fy = s.y - std::floor(s.y);
    return (fx * fx + (1 - fx) * (1 - fx)) * (fy * fy + (1 - fy) * (1 - fy));
  }
  // What is expected of a sample: all by the wall, not by the sample, whose noise would choose.
  struct Expected {
    double light = 0;
    double residual = 0;  // of the light, relative
    double weight = 0;    // inverse of the variance in effect, where neighbours share their noise
    double freedom = 1;   // share of its variance that the residual has
  };
  // Residuals are linear in the light and relative to that mean: views that see the texture blurred
  // have the same mean of the light, but not of its logarithm, nor of its ratio to sharper light.
  [[nodiscard]] Expected Expect(const WallSample& s, size_t row, size_t column) const {
    const float c = c_[row][column], around = around_[row][column];
    const double scale = std::exp(Predicted(s)) * wall_.views[s.view].exposure;
    const double light = scale * std::exp(c);
    Expected at{.light = std::isnan(around) ? light : scale * std::exp(around)};
    at.residual = robust_ ? (s.light - light) / at.light : std::log(s.light / light);
    const double variance = LogVariance(at.light);
    at.weight = 1 / (variance * std::max<double>(s.density, kLeastDensity));
    if (robust_) {
      // Values between pixels are off by the contrast of these, which is no reason to leave out.
      const double spread = variance * Mixing(s) + contrast_[row][column];
      at.weight *= TukeyWeight(Square(at.residual) / (Square(kTukeyWidth) * spread));
    }
    return at;
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
        const auto begin = row.samples.begin() + row.begin[cell];
        const auto end = row.samples.begin() + row.begin[cell + 1];
        if (std::isnan(c) && begin != end) {
          double sum = 0;
          for (auto s = begin; s != end; ++s) sum += s->brightness - Predicted(*s);
          c = static_cast<float>(sum / static_cast<double>(end - begin));
        }
        double sum = 0, weight = 0;
        for (auto s = begin; s != end; ++s) {
          const Expected at = Expect(*s, r, cell);
          sum += at.weight * at.residual;
          weight += at.weight;
        }
        if (weight > 0) {
          // Residuals are relative to the brightness around the cell once weights are robust.
          const double base = robust_ && !std::isnan(around_[r][cell]) ? around_[r][cell] : c;
          c = static_cast<float>(c + std::log1p(std::exp(base - c) * sum / weight));
        } else {
          c = kNoBrightness;
        }
      }
    });
    ParallelFor(rows_.size(), threads_, [&](size_t r) {
      for (size_t cell = 0; cell < around_[r].size(); ++cell) {
        constexpr size_t kReach = kBlockCells / 2;
        double sum = 0, count = 0;
        for (size_t y = r - std::min(r, kReach); y < std::min(r + kReach + 1, rows_.size()); ++y) {
          const size_t end = std::min(cell + kReach + 1, c_[y].size());
          for (size_t x = cell - std::min(cell, kReach); x < end; ++x) {
            if (std::isnan(c_[y][x])) continue;
            sum += std::exp(c_[y][x]);
            count += 1;
          }
        }
        around_[r][cell] = static_cast<float>(std::log(sum / count));
        const double contrast = Texture(r, cell);
        contrast_[r][cell] = std::isnan(contrast) ? 0 : static_cast<float>(contrast);
      }
    });
  }

  // Where a sample is, and the part of the work that has it.
  struct SamplePlace {
    size_t part, row, column;
  };
  // Calls body(place, sample, what is expected) for all samples that count. A part has whole
  // blocks, row by row.
  template <typename Body>
  void ForSamples(const Body& body) const {
    ParallelFor(kParts, threads_, [&](size_t part) {
      std::vector<Expected> expected;
      constexpr size_t kSkip = (kParts - 1) * kBlockCells;
      for (size_t r = part * kBlockCells; r < rows_.size();
           r += r % kBlockCells + 1 == kBlockCells ? kSkip + 1 : 1) {
        const WallRow& row = rows_[r];
        for (size_t cell = 0; cell + 1 < row.begin.size(); ++cell) {
          const float c = c_[r][cell];
          if (std::isnan(c)) continue;
          expected.clear();
          double total = 0;
          for (size_t i = row.begin[cell]; i < row.begin[cell + 1]; ++i) {
            expected.push_back(Expect(row.samples[i], r, cell));
            total += expected.back().weight;
          }
          for (size_t i = row.begin[cell]; i < row.begin[cell + 1]; ++i) {
            Expected& at = expected[i - row.begin[cell]];
            if (!(at.weight > 0)) continue;
            at.freedom = std::max(1 - at.weight / total, 0.1);
            body(SamplePlace{part, r, cell}, row.samples[i], at);
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
            const Expected at = Expect(s, r, cell);
            const double residual = at.residual, w = at.weight;
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

  [[nodiscard]] double GainSigma() const {
    return wall_.exposures_known ? kGainSigma : kUnknownGain;
  }
  // Gains about 1; mean of v 0, for a factor of it is one of the wall; and hardly any bend where
  // there are no data.
  void AddPriors(CoarseSystem* system) const {
    const Eigen::Index nv = coarse_.Coefficients();
    for (size_t i = 0; i < gains_.size(); ++i) {
      const Eigen::Index at = nv + static_cast<Eigen::Index>(i);
      system->S(at, at) += 1 / Square(GainSigma());
      system->b[at] -= gains_[i] / Square(GainSigma());
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

  // Covariance of the coarse unknowns. That of their normal equations is what blocks of the wall,
  // whose errors are independent, scatter by: noise, and texture between the pixels.
  [[nodiscard]] Eigen::MatrixXd CoarseCovariance(const CoarseSystem& system) const {
    const Eigen::Index nv = coarse_.Coefficients(), n = system.b.size();
    const auto columns =
        static_cast<Eigen::Index>(static_cast<size_t>(grid_.columns) / kBlockCells + 1);
    struct Scatter {
      Eigen::MatrixXd M, blocks;  // blocks: of one row of them, in columns
      size_t row = 0;
      double count = 0;
      void FinishRow() {
        M.noalias() += blocks * blocks.transpose();
        count += static_cast<double>((blocks.colwise().squaredNorm().array() > 0).count());
        blocks.setZero();
      }
    };
    std::vector<Scatter> parts(kParts,
                               {Eigen::MatrixXd::Zero(n, n), Eigen::MatrixXd::Zero(n, columns)});
    ForSamples([&](const SamplePlace& place, const WallSample& s, const Expected& at) {
      Scatter& part = parts[place.part];
      if (part.row != place.row / kBlockCells) part.FinishRow();
      part.row = place.row / kBlockCells;
      auto score = part.blocks.col(static_cast<Eigen::Index>(place.column / kBlockCells));
      const ImageSpline::Basis basis = coarse_.At(projector_.Enlarge(s.x), projector_.Enlarge(s.y));
      const double value = at.weight * at.residual;
      for (size_t k = 0; k < ImageSpline::kSupport; ++k) {
        score[basis.index[k]] += value * basis.weight[k];
      }
      score[nv + s.view] += value;
    });
    Scatter& all = parts[0];
    for (Scatter& part : parts) {
      part.FinishRow();
      if (&part == &all) continue;
      all.M += part.M;
      all.count += part.count;
    }
    all.M *= all.count / std::max(all.count - static_cast<double>(n), 1.0);  // degrees of freedom
    all.M.diagonal().tail(n - nv).array() += 1 / Square(GainSigma());        // the prior's
    const Eigen::MatrixXd inverse = Inverse(system.S);
    return inverse * all.M * inverse;
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
    ForSamples([&](const SamplePlace& place, const WallSample& s, const Expected& at) {
      const double value = at.residual + Interpolate(v_, s.x, s.y);
      const int x = cvRound(s.x), y = cvRound(s.y);
      parts[place.part].weight.at<double>(y, x) += at.weight;
      parts[place.part].value.at<double>(y, x) += at.weight * value;
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
    ForSamples([&](const SamplePlace& place, const WallSample& s, const Expected& at) {
      const int block = static_cast<int>(s.y / side) * size.width + static_cast<int>(s.x / side);
      parts[place.part].weight(block, s.view) += at.weight;
      parts[place.part].value(block, s.view) += at.weight * at.residual;
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

    // Variance of the coarse spline, and what that of the fine one with wall and gains known is
    // larger by.
    const Eigen::Index nv = coarse_.Coefficients();
    const Eigen::MatrixXd fine_covariance = MakeFineFit().Covariance();
    const Eigen::MatrixXd all = CoarseCovariance(system);
    const Eigen::MatrixXd covariance = all.topLeftCorner(nv, nv);
    // Of gains against their mean: an error that all share is one of the wall's brightness.
    const Eigen::MatrixXd of_gains = all.bottomRightCorner(all.rows() - nv, all.rows() - nv);
    const Eigen::VectorXd share = used_ / used_.sum(), means = of_gains * share;
    for (Eigen::Index i = 0; i < means.size(); ++i) {
      result->gain_sigma.push_back(std::sqrt(of_gains(i, i) - 2 * means[i] + share.dot(means)));
    }
    const Eigen::MatrixXd known = Inverse(system.known);
    const cv::Mat common_noise = cv::max(NoiseOfSingleViews(), NoiseOfAllViews());
    cv::Mat sigma(v_.size(), CV_32F);
    ParallelFor(static_cast<size_t>(v_.rows), threads_, [&](size_t row) {
      const int y = static_cast<int>(row);
      for (int x = 0; x < v_.cols; ++x) {
        const double px = projector_.Enlarge(x), py = projector_.Enlarge(y);
        const ImageSpline::Basis coarse = coarse_.At(px, py);
        const double fine =
            VarianceAt(fine_.At(px, py), fine_covariance) - VarianceAt(coarse, known);
        sigma.at<float>(y, x) = static_cast<float>(std::sqrt(
            common_noise.at<float>(y, x) * std::max(fine, 0.0) + VarianceAt(coarse, covariance)));
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
    ForSamples([&](const SamplePlace& place, const WallSample& s, const Expected& at) {
      Sums& sums = parts[place.part];
      const RigidTransform& T = wall_.views[s.view].T_camera_wall;
      const Eigen::Vector3d p =
          T * grid_.At(static_cast<int>(place.column), static_cast<int>(place.row));
      const double cosine = std::min(std::abs(T.R.col(2).dot(p)) / p.norm(), 1.0);
      const auto bin = static_cast<size_t>(std::acos(cosine) / std::numbers::pi * 2 * (kBins - 1));
      sums.weight[bin] += at.weight;
      sums.residual[bin] += at.weight * at.residual;
      const double residual = at.residual;
      const double spread = LogVariance(at.light) * Mixing(s) * at.freedom;
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

  // Residuals of the worst parts of the wall against those of the best ones, each over what noise
  // and the wall's own texture make of it: values between pixels and another blur leave a share of
  // the contrast of neighbouring cells, which is the same everywhere.
  [[nodiscard]] double Unevenness() const {
    struct Block {
      double square = 0, noise = 0, texture = 0;
    };
    const size_t columns = static_cast<size_t>(grid_.columns) / kBlockCells + 1;
    std::vector<Block> blocks((rows_.size() / kBlockCells + 1) * columns);
    ForSamples([&](const SamplePlace& place, const WallSample& s, const Expected& at) {
      const double texture = Texture(place.row, place.column);
      if (std::isnan(texture)) return;
      Block& block = blocks[place.row / kBlockCells * columns + place.column / kBlockCells];
      block.square += Square(at.residual) / at.freedom;
      block.noise += LogVariance(at.light) * Mixing(s);
      block.texture += texture;
    });
    std::erase_if(blocks, [](const Block& block) { return !(block.texture > 0); });
    if (blocks.empty()) return 0;
    std::vector<double> shares, ratios;
    for (const Block& block : blocks) {
      shares.push_back(std::max(block.square - block.noise, 0.0) / block.texture);
    }
    const double share = Median(shares);
    for (const Block& block : blocks) {
      ratios.push_back(block.square / (block.noise + share * block.texture));
    }
    return Quantile(&ratios, 0.9) / Quantile(&ratios, 0.2);
  }
  // Mean square of the differences of a cell's brightness from those beside it, relative.
  [[nodiscard]] double Texture(size_t row, size_t column) const {
    if (row == 0 || column == 0 || row + 1 >= c_.size() || column + 1 >= c_[row].size()) {
      return std::numeric_limits<double>::quiet_NaN();
    }
    const float c = c_[row][column];
    return (Square(c_[row - 1][column] - c) + Square(c_[row + 1][column] - c) +
            Square(c_[row][column - 1] - c) + Square(c_[row][column + 1] - c)) /
           4;
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
  Eigen::VectorXd used_;       // by view: 1, or 0 of a misplaced one
  cv::Mat v_;                  // of the reduced image
  Eigen::VectorXd fine_coefficients_;
  std::vector<WallRow> rows_;
  std::vector<std::vector<float>> c_;         // by row and column of the grid
  std::vector<std::vector<float>> around_;    // logarithm of the mean around each cell
  std::vector<std::vector<float>> contrast_;  // Texture of each cell, 0 where it has none
  double noise_gain_ = 0, noise_read_ = 0;    // variance of a pixel's light: gain * light + read
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
    throw JobError(
        "{}: the images have only {} measurements of points that at least three "
        "of them show; move the camera less between images, avoid saturation",
        where,
        solver.Measurements());
  }
  report("wall: first rounds");
  solver.Round();
  solver.Round();
  const auto refine_poses = [&] {
    report("wall: poses by its texture");
    solver.RefinePoses();
    solver.Round();
  };
  for (int i = 0; i < 3; ++i) refine_poses();
  while (solver.LeaveOutMisplaced()) solver.Round();
  solver.EstimateNoise();
  refine_poses();
  solver.EstimateNoise();
  report("wall: last rounds");
  for (int i = 0; i < 3; ++i) solver.Round();
  solver.EstimateNoise();
  solver.Round();
  report("wall: standard deviations");
  return solver.Result();
}

}  // namespace plenocal
