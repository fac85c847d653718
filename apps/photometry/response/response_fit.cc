// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/response/response_fit.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>

#include "apps/photometry/response/rising_values.h"
#include "apps/photometry/response/sum_parts.h"
#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/parallel.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr int kMeanRounds = 6;                    // with means in place of borders
constexpr int kBorderRounds = 8;                  // of borders with the exposures as recorded
constexpr int kFirstRounds = 3, kLastRounds = 3;  // of borders and exposures together

// Estimating equations of the unknowns: borders, then ln(exposure / recorded one). The light of
// each pixel is eliminated.
struct JointEquations {
  Eigen::MatrixXd J;  // derivative of -score
  Eigen::MatrixXd M;  // the score's covariance, by its scatter over the pixels

  JointEquations& operator+=(const JointEquations& more) {
    J += more.J;
    M += more.M;
    return *this;
  }
};

class ResponseFit {
 public:
  static constexpr size_t kGreys = SensorCurve::kGreys, kBorders = SensorCurve::kBorders;

  ResponseFit(const ExposureSweep& sweep, int threads)
      : sweep_(sweep),
        threads_(threads),
        exposures_(sweep.exposures),
        light_(sweep.grey[0].size(), kNaN),
        x_(Eigen::VectorXd::Zero(static_cast<Eigen::Index>(exposures_.size()))) {}

  void Run() {
    for (int round = 0; round < kMeanRounds; ++round) {
      EstimateLight();
      SetValuesToMeans();
    }
    for (int round = 0; round < kBorderRounds; ++round) {
      EstimateLight();
      const BorderEquations equations = curve_.Linearise(MakeHistogram());
      curve_.MoveBorders(equations.score.cwiseQuotient(
          equations.information.cwiseMax(std::numeric_limits<double>::min())));
    }
    for (int round = 0; round < kFirstRounds; ++round) AdjustTogether();
    EstimateLight();
    LeaveOutMoving();
    for (int round = 0; round < kLastRounds; ++round) AdjustTogether();
    EstimateLight();
  }

  [[nodiscard]] const SensorCurve& Curve() const { return curve_; }

  void SetResult(ResponseEstimate* result) const {
    result->noise = curve_.Noise();
    result->exposure_sigma = exposure_sigma_;
    for (const double x : x_) result->exposure_errors.push_back(std::expm1(x));
    double squares = 0, number = 0;
    for (size_t j = 0; j < light_.size(); ++j) {
      if (!(light_[j] > 0)) continue;
      ++result->pixels;
      for (size_t i = 0; i < exposures_.size(); ++i) {
        const std::uint8_t grey = sweep_.grey[i][j];
        ++result->count[grey];
        const double u = exposures_[i] * light_[j];
        if (!IsUsed(i, j, u)) continue;
        squares += SquareOf(curve_.Middle(grey) - u);
        number += 1;
      }
    }
    result->rms = std::sqrt(squares / number);
    result->moving = moving_;
    result->sigma = sigma_;
  }

 private:
  // Chosen by the light, not by the grey value, whose noise would choose.
  [[nodiscard]] bool IsUsed(size_t image, size_t j, double u) const {
    return curve_.MeasuresWithoutBias(u) && !sweep_.beside_saturated[image][j];
  }

  // Sums over one pixel of all images: light = sum / weight.
  struct PixelSums {
    double sum = 0, weight = 0;
    std::vector<double> weights;  // by image
    [[nodiscard]] double Light() const { return weight > 0 ? sum / weight : 0; }
  };
  // body(pixel, &scratch) for all pixels in use of one part of the sums.
  template <typename Body>
  void ForPixels(size_t part, const Body& body) const {
    PixelSums scratch;
    for (size_t j = part; j < light_.size(); j += kSumParts) {
      if (std::isnan(light_[j]) || light_[j] > 0) body(j, &scratch);
    }
  }
  void SumPixel(size_t j, PixelSums* sums) const {
    const bool first = std::isnan(light_[j]);
    sums->sum = sums->weight = 0;
    sums->weights.assign(exposures_.size(), 0);
    for (size_t i = 0; i < exposures_.size(); ++i) {
      const double t = exposures_[i], value = curve_.Middle(sweep_.grey[i][j]);
      const double u = first ? value : t * light_[j];
      if (!IsUsed(i, j, u)) continue;
      const double w = sums->weights[i] = 1 / curve_.VarianceAt(u);
      sums->sum += w * t * value;
      sums->weight += w * t * t;
    }
  }
  // The light as all other images have it: its error is independent of this one's. False if it is
  // not known, or the image does not count.
  bool LightByOthers(const PixelSums& sums, size_t i, size_t j, double* u, double* others) const {
    const double t = exposures_[i], w = sums.weights[i];
    *others = sums.weight - w * t * t;
    if (sweep_.beside_saturated[i][j] || !(*others > sums.weight * 1e-9)) return false;
    *u = t * (sums.sum - w * t * curve_.Middle(sweep_.grey[i][j])) / *others;
    return LightHistogram::Holds(*u);
  }

  void EstimateLight() {
    ParallelFor(kSumParts, threads_, [&](size_t part) {
      ForPixels(part, [&](size_t j, PixelSums* sums) {
        SumPixel(j, sums);
        light_[j] = sums->Light();
      });
    });
  }

  void SetValuesToMeans() {
    ResponseCurve::Table mean{}, count{};
    for (size_t j = 0; j < light_.size(); ++j) {
      if (!(light_[j] > 0)) continue;
      for (size_t i = 0; i < exposures_.size(); ++i) {
        const std::uint8_t grey = sweep_.grey[i][j];
        if (grey == kGreys - 1 || sweep_.beside_saturated[i][j]) continue;
        mean[grey] += exposures_[i] * light_[j];
        count[grey] += 1;
      }
    }
    for (size_t k = 0; k < kGreys; ++k) mean[k] = count[k] > 0 ? mean[k] / count[k] : kNaN;
    curve_.SetValues(mean, count);
  }

  [[nodiscard]] LightHistogram MakeHistogram() const {
    return SumParts(LightHistogram(), threads_, [&](size_t part, LightHistogram* histogram) {
      ForPixels(part, [&](size_t j, PixelSums* sums) {
        SumPixel(j, sums);
        for (size_t i = 0; i < exposures_.size(); ++i) {
          double u = 0, others = 0;
          if (!LightByOthers(*sums, i, j, &u, &others)) continue;
          histogram->Add(u, SquareOf(exposures_[i]) / others, sweep_.grey[i][j]);
        }
      });
    });
  }

  // Pixels whose residuals are larger than noise: the scene moved there.
  void LeaveOutMoving() {
    constexpr double kOneIn = 1e-4;
    for (double& light : light_) {
      if (!(light > 0)) continue;
      const auto j = static_cast<size_t>(&light - light_.data());
      double chi_square = 0;
      int number = 0;
      for (size_t i = 0; i < exposures_.size(); ++i) {
        const double u = exposures_[i] * light;
        if (!IsUsed(i, j, u)) continue;
        chi_square += SquareOf(curve_.Middle(sweep_.grey[i][j]) - u) / curve_.VarianceAt(u);
        ++number;
      }
      if (number > 1 && ChiSquareTail(number - 1, chi_square) < kOneIn) {
        light = 0;
        ++moving_;
      }
    }
  }

  // The score of the exposures.
  [[nodiscard]] Eigen::VectorXd ExposureScore() const {
    const Eigen::VectorXd zero = Eigen::VectorXd::Zero(x_.size());
    return SumParts(zero, threads_, [&](size_t part, Eigen::VectorXd* score) {
      ForPixels(part, [&](size_t j, PixelSums*) {
        for (size_t i = 0; i < exposures_.size(); ++i) {
          const double u = exposures_[i] * light_[j];
          if (!IsUsed(i, j, u)) continue;
          (*score)[static_cast<Eigen::Index>(i)] +=
              u * (curve_.Middle(sweep_.grey[i][j]) - u) / curve_.VarianceAt(u);
        }
      });
    });
  }

  [[nodiscard]] JointEquations Linearise(const BorderEquations& borders) const {
    // The work grows with the square of the unknowns; some pixels are as good a sample.
    constexpr size_t kEnough = 4000;
    const size_t step = (light_.size() + kEnough - 1) / kEnough;
    const Eigen::Index n = kBorders + x_.size();
    const JointEquations zero{Eigen::MatrixXd::Zero(n, n), Eigen::MatrixXd::Zero(n, n)};
    JointEquations system = SumParts(zero, threads_, [&](size_t part, JointEquations* sum) {
      // Of pixels, in columns: products of matrices are fast.
      constexpr Eigen::Index kColumns = 64;
      PixelScores scores(n, kColumns);
      PixelSums sums;
      Eigen::Index column = 0;
      const auto flush = [&] {
        sum->J.noalias() -= scores.by_light * scores.light_by.transpose();
        sum->M.noalias() += scores.score * scores.score.transpose();
        scores = PixelScores(n, kColumns);
        column = 0;
      };
      for (size_t j = part * step; j < light_.size(); j += kSumParts * step) {
        if (!(light_[j] > 0)) continue;
        SumPixel(j, &sums);
        AddPixel(j, sums, borders, column, &scores, &sum->J);
        if (++column == kColumns) flush();
      }
      flush();
    });
    system.J *= static_cast<double>(step);
    system.M *= static_cast<double>(step);
    return system;
  }

  struct PixelScores {
    PixelScores(Eigen::Index n, Eigen::Index columns) {
      score = by_light = light_by = Eigen::MatrixXd::Zero(n, columns);
    }
    Eigen::MatrixXd score, by_light,
        light_by;  // by_light: d score / d E; light_by: d E / d unknown
  };
  void AddPixel(size_t j,
                const PixelSums& sums,
                const BorderEquations& borders,
                Eigen::Index column,
                PixelScores* scores,
                Eigen::MatrixXd* J) const {
    auto score = scores->score.col(column), by_light = scores->by_light.col(column);
    auto light_by = scores->light_by.col(column);
    const double E = sums.Light();
    for (size_t i = 0; i < exposures_.size(); ++i) {
      const double t = exposures_[i], w = sums.weights[i], share = w * t * t / sums.weight;
      const size_t grey = sweep_.grey[i][j];
      const Eigen::Index x = kBorders + static_cast<Eigen::Index>(i);
      // The light of a grey value is the mean of both borders.
      const bool between = w > 0 && curve_.Measures(grey);
      const auto below = static_cast<Eigen::Index>(grey) - 1;
      if (w > 0) {
        score[x] += w * t * E * (curve_.Middle(grey) - t * E);
        by_light[x] -= w * t * t * E;
        light_by[x] -= share * E;
        (*J)(x, x) += w * SquareOf(t * E);
      }
      if (between) {
        for (const Eigen::Index k : {below, below + 1}) {
          light_by[k] += w * t / (2 * sums.weight);
          (*J)(x, k) -= w * t * E / 2;
        }
      }
      double u = 0, others = 0;
      if (!LightByOthers(sums, i, j, &u, &others)) continue;
      const size_t b = LightHistogram::BinOf(u);
      const BorderEquations::Bin& bin = borders.bins[b];
      const double factor = sums.weight / others;  // d u / d E / t
      for (size_t k = bin.first; k < bin.end; ++k) {
        if (!curve_.IsKnown(k)) continue;
        const double density = borders.density[b * kBorders + k];
        const double slope = density * density / bin.sigma;
        const auto row = static_cast<Eigen::Index>(k);
        score[row] += density * ((grey <= k ? 1 : 0) - borders.distribution[b * kBorders + k]);
        by_light[row] += slope * factor * t;
        (*J)(row, row) += slope;
        (*J)(row, x) -= slope * factor * u;
        if (between) {  // the light by others does not have it
          (*J)(row, below) += slope * factor * share / 2;
          (*J)(row, below + 1) += slope * factor * share / 2;
        }
      }
    }
  }

  // Newton's step of borders and exposures, whose errors have a standard deviation that is
  // estimated with them (moments), and standard deviations of the values.
  void AdjustTogether() {
    const Eigen::Index nx = x_.size();
    EstimateLight();
    const BorderEquations borders = curve_.Linearise(MakeHistogram());
    auto [J, M] = Linearise(borders);
    const Eigen::MatrixXd prior = ExposurePrior(J);
    J.bottomRightCorner(nx, nx) += prior;
    for (size_t k = 0; k < kBorders; ++k) {
      const auto row = static_cast<Eigen::Index>(k);
      if (!curve_.IsKnown(k)) J(row, row) = 1;
    }
    // The factor of all light is open.
    const Eigen::VectorXd scale = curve_.KnownBorders().normalized();
    J.topLeftCorner(kBorders, kBorders) +=
        J.diagonal().head(kBorders).sum() * scale * scale.transpose();
    Eigen::VectorXd score(kBorders + nx);
    score << borders.score, ExposureScore() - prior * x_;
    const Eigen::MatrixXd inverse = Inverse(J);
    const Eigen::VectorXd change = inverse * score;
    x_ += change.tail(nx);
    for (size_t i = 0; i < exposures_.size(); ++i) {
      exposures_[i] = sweep_.exposures[i] * std::exp(x_[static_cast<Eigen::Index>(i)]);
    }
    curve_.MoveBorders(change.head(kBorders));
    // x = R (true x) + noise
    const Eigen::MatrixXd shrink = inverse.rightCols(nx) * prior;
    const Eigen::MatrixXd R = Eigen::MatrixXd::Identity(nx, nx) - shrink.bottomRows(nx);
    const Eigen::MatrixXd of_noise = inverse * M * inverse.transpose();
    const double excess = x_.squaredNorm() - of_noise.diagonal().tail(nx).sum();
    constexpr double kExact = 1e-6;
    exposure_sigma_ = std::sqrt(std::max(excess / R.squaredNorm(), SquareOf(kExact)));
    SetSigma(of_noise + SquareOf(exposure_sigma_) * shrink * shrink.transpose());
  }

  // Exposures take from the images what these determine nearly as well as each pixel's brightness
  // does. The rest would follow small errors of the sensor's model and is left to the exposures as
  // recorded; most of all the response's exponent: exposures t^a and light E^a show the same
  // images.
  [[nodiscard]] Eigen::MatrixXd ExposurePrior(const Eigen::MatrixXd& J) const {
    constexpr double kLeastPrior = 0.03,
                     kFixed = 1e4;  // of the information of a pixel's brightness
    const double information = J.diagonal().tail(x_.size()).mean();
    Eigen::VectorXd exponent = Eigen::VectorXd::Zero(x_.size());
    for (size_t i = 0; i < exposures_.size(); ++i) {
      exponent[static_cast<Eigen::Index>(i)] = std::log(sweep_.exposures[i]);
    }
    exponent.array() -= exponent.mean();
    exponent.normalize();
    const double precision = std::max(1 / SquareOf(exposure_sigma_), kLeastPrior * information);
    return precision * Eigen::MatrixXd::Identity(x_.size(), x_.size()) +
           kFixed * information * exponent * exponent.transpose();
  }

  // Sigma of the values that were seen, up to the factor that makes the errors orthogonal to them.
  void SetSigma(const Eigen::MatrixXd& covariance) {
    Eigen::MatrixXd T = curve_.ValuesByBorders();
    Eigen::VectorXd values = Eigen::VectorXd::Zero(kGreys);
    for (size_t k = 0; k < kGreys; ++k) {
      if (curve_.Measures(k)) values[static_cast<Eigen::Index>(k)] = curve_.Values()[k];
    }
    T -= values * (values.transpose() * T) / values.squaredNorm();
    const Eigen::VectorXd variances =
        (T * covariance.topLeftCorner(kBorders, kBorders) * T.transpose()).diagonal();
    for (size_t k = 0; k < kGreys; ++k) {
      sigma_[k] = curve_.Measures(k) ? std::sqrt(variances[static_cast<Eigen::Index>(k)]) : kNaN;
    }
  }

  static constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  const ExposureSweep& sweep_;
  int threads_;
  std::vector<double> exposures_;  // as estimated
  std::vector<double> light_;      // E by pixel; NaN: not yet known, 0: not used
  Eigen::VectorXd x_;              // ln(exposure / recorded one)
  double exposure_sigma_ = 1e-4;   // of these; estimated soon
  SensorCurve curve_;
  ResponseCurve::Table sigma_{};
  size_t moving_ = 0;
};

void CheckSweep(const ExposureSweep& sweep, const std::string& where) {
  const auto [least, largest] = std::ranges::minmax(sweep.exposures);
  constexpr double kLeastRatio = 2;
  if (!(largest >= kLeastRatio * least)) {
    throw JobError(
        "{}: exposures are from {:.4g} to {:.4g} ms; a response needs a static "
        "scene at exposures that differ by a factor of 10 or more",
        where,
        least,
        largest);
  }
  size_t saturated = 0, black = 0, all = 0;
  for (const auto& image : sweep.grey) {
    saturated += static_cast<size_t>(std::ranges::count(image, SensorCurve::kBorders));
    black += static_cast<size_t>(std::ranges::count(image, 0));
    all += image.size();
  }
  const auto check = [&](size_t count, const char* what, const char* remedy) {
    constexpr double kMost = 0.95;
    const double share = static_cast<double>(count) / static_cast<double>(all);
    if (!(share > kMost)) return;
    throw JobError("{}: {:.0f} % of the pixels are {}; use {}", where, 100 * share, what, remedy);
  };
  check(saturated, "saturated", "shorter exposures or less light");
  check(black, "black", "longer exposures or more light");
}

}  // namespace

ResponseEstimate FitResponse(const ExposureSweep& sweep, const std::string& where, int threads) {
  CheckSweep(sweep, where);
  ResponseFit fit(sweep, threads);
  fit.Run();
  ResponseEstimate result;
  fit.SetResult(&result);
  if (result.moving > result.pixels) {
    throw JobError(
        "{}: in most pixels the light is not proportional to the exposure; the "
        "camera and the scene must stand still, the gain must be fixed and the "
        "lamp must not flicker",
        where);
  }
  std::vector<size_t> known;
  for (size_t k = 0; k < SensorCurve::kBorders; ++k) {
    if (fit.Curve().IsKnown(k)) known.push_back(k);
  }
  constexpr size_t kFewestBorders = 20;
  if (known.size() < kFewestBorders) {
    throw JobError(
        "{}: only {} of 255 borders between grey values were seen; use a scene "
        "with dark and bright parts and more exposures between them",
        where,
        known.size());
  }
  result.first = static_cast<int>(known.front());
  result.last = static_cast<int>(known.back()) + 1;
  ResponseCurve::Table values = fit.Curve().Values();
  // Light is not negative, and response files have none at grey value 0.
  std::array<double, SensorCurve::kGreys> weights{};
  for (size_t k = 0; k < SensorCurve::kGreys; ++k) {
    values[k] = std::max(values[k], 0.0);
    weights[k] = k == 0 ? 1e12 : static_cast<double>(result.count[k]);
  }
  MakeRising(values, weights);
  result.curve = ResponseCurve(values);
  return result;
}

}  // namespace plenocal
