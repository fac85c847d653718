// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/response/sensor_curve.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <numeric>

#include "apps/photometry/response/noise_line.h"
#include "apps/photometry/response/rising_values.h"

namespace plenocal {
namespace {

constexpr size_t kBins = LightHistogram::kBins;
constexpr double kFull = 255;
constexpr double kCutSigmas = 4;                // noise beyond is not missed where it is cut off
constexpr double kNearSigmas = kCutSigmas + 1;  // of borders to light

double NormalDensity(double x) { return std::exp(-x * x / 2) / std::sqrt(2 * std::numbers::pi); }
double NormalDistribution(double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); }
// P(noise < x sigma) with the skewness of counted electrons (F. Y. Edgeworth's series).
double NoiseDistribution(double x, double skewness) {
  return NormalDistribution(x) - skewness / 6 * (x * x - 1) * NormalDensity(x);
}

}  // namespace

size_t LightHistogram::BinOf(double u) {
  return u > 0 ? static_cast<size_t>(std::sqrt(u / kMostLight) * kBins) : 0;  // NaN: the first
}

double LightHistogram::LightOf(size_t bin) {
  return SquareOf((static_cast<double>(bin) + 0.5) / kBins) * kMostLight;
}

void LightHistogram::Add(double u, double error_variance, std::uint8_t grey) {
  const size_t bin = BinOf(u);
  ++count[bin * SensorCurve::kGreys + grey];
  pixels[bin] += 1;
  light[bin] += u;
  variance[bin] += error_variance;
}

LightHistogram& LightHistogram::operator+=(const LightHistogram& other) {
  const auto add = [](auto& to, const auto& from) {
    std::ranges::transform(to, from, to.begin(), std::plus<>());
  };
  add(count, other.count);
  add(pixels, other.pixels);
  add(light, other.light);
  add(variance, other.variance);
  return *this;
}

SensorCurve::SensorCurve() {
  Table line;
  std::iota(line.begin(), line.end(), 0.0);
  SetValues(line, line);
}

void SensorCurve::SetValues(const Table& values, const Table& weights) {
  values_ = values;
  Complete();
  MakeRising(values_, weights);
  for (size_t k = 0; k < kBorders; ++k) borders_[k] = (values_[k] + values_[k + 1]) / 2;
  Tabulate();
}

// Fills values that were not seen and scales all; returns the factor. Noise may have exchanged dark
// values: only the result is made to rise, or it would be too bright.
double SensorCurve::Complete() {
  values_[0] = 0;
  FillGaps(values_);
  const double scale = kFull / values_[kGreys - 1];
  for (double& value : values_) value *= scale;
  return scale;
}

void SensorCurve::Tabulate() {
  middles_ = values_;
  for (size_t k = 1; k < kBorders; ++k) middles_[k] = (borders_[k - 1] + borders_[k]) / 2;
  darkest_ = 0;
  for (size_t b = 0; b < kBins; ++b) {
    const double u = LightHistogram::LightOf(b);
    variances_[b] = Variance(u);
    if (u < kCutSigmas * std::sqrt(variances_[b])) darkest_ = u;
  }
  brightest_ = borders_.back() - kCutSigmas * std::sqrt(Variance(borders_.back()));
}

double SensorCurve::Variance(double u) const {
  const auto value = std::ranges::upper_bound(values_, u);
  const auto k = std::clamp<size_t>(static_cast<size_t>(value - values_.begin()), 1, kGreys - 1);
  const double step = values_[k] - values_[k - 1];
  return std::max(noise_.gain * u + SquareOf(noise_.read) + step * step / 12, 1e-12);
}

double SensorCurve::VarianceAt(double u) const {
  return variances_[LightHistogram::BinOf(std::clamp(u, 0.0, kFull))];
}

// Straight line of the variance of grey values' light over the light.
void SensorCurve::EstimateNoise(const LightHistogram& histogram) {
  NoiseLine line;
  for (size_t b = 0; b < kBins; ++b) {
    const double n = histogram.pixels[b];
    constexpr double kFewest = 30;
    if (n < kFewest) continue;
    const double u = histogram.light[b] / n;
    if (!MeasuresWithoutBias(u)) continue;
    const double assumed = VarianceAt(u);
    double mean = 0, square = 0;
    for (size_t k = 0; k < kGreys; ++k) {
      const double count = histogram.count[b * kGreys + k];
      mean += count * middles_[k];
      square += count * middles_[k] * middles_[k];
    }
    mean /= n;
    const double rounding = assumed - noise_.gain * u - SquareOf(noise_.read);
    const double width = 2 * std::sqrt(u * LightHistogram::kMostLight) / kBins;
    const double variance =
        square / n - mean * mean - rounding - histogram.variance[b] / n - width * width / 12;
    line.Add(n / SquareOf(assumed), u, variance);
  }
  if (!line.IsDetermined()) return;
  const double gain = line.Gain(), read = line.ReadVariance();
  // One of the two alone where the other comes out negative.
  noise_.gain = read > 0 ? std::max(gain, 0.0) : std::max(line.GainAlone(), 0.0);
  noise_.read = gain > 0 ? std::sqrt(std::max(read, 0.0))
                         : std::sqrt(std::max(line.ReadVarianceAlone(), 0.0));
}

BorderEquations SensorCurve::Linearise(const LightHistogram& histogram) {
  EstimateNoise(histogram);
  BorderEquations equations;
  equations.density.resize(kBins * kBorders);
  equations.distribution.resize(kBins * kBorders);
  equations.score = equations.information = Eigen::VectorXd::Zero(kBorders);
  std::array<double, kBorders> below{}, above{};
  for (size_t b = 0; b < kBins; ++b) {
    const double n = histogram.pixels[b];
    if (n == 0) continue;
    const double u = histogram.light[b] / n;
    BorderEquations::Bin& bin = equations.bins[b];
    bin.sigma = std::sqrt(
        std::max(noise_.gain * u + SquareOf(noise_.read) + histogram.variance[b] / n, 1e-12));
    const double skewness = SquareOf(noise_.gain) * u / std::pow(bin.sigma, 3);
    const auto is_near = [&](double border) {
      return std::abs(border - u) < kNearSigmas * bin.sigma;
    };
    bin.first = static_cast<size_t>(std::ranges::find_if(borders_, is_near) - borders_.begin());
    const std::uint32_t* count = &histogram.count[b * kGreys];
    double lower = std::accumulate(count, count + bin.first, 0.0);
    for (bin.end = bin.first; bin.end < kBorders && is_near(borders_[bin.end]); ++bin.end) {
      const size_t k = bin.end;
      const auto row = static_cast<Eigen::Index>(k);
      const double x = (borders_[k] - u) / bin.sigma;
      const double density = NormalDensity(x), distribution = NoiseDistribution(x, skewness);
      equations.density[b * kBorders + k] = static_cast<float>(density);
      equations.distribution[b * kBorders + k] = static_cast<float>(distribution);
      lower += count[k];
      equations.score[row] += density * (lower - n * distribution);
      equations.information[row] += n * density * density / bin.sigma;
      below[k] += lower;
      above[k] += n - lower;
    }
  }
  constexpr double kFewest = 20;
  for (size_t k = 0; k < kBorders; ++k) {
    const auto row = static_cast<Eigen::Index>(k);
    known_[k] = equations.information[row] > 0 && below[k] >= kFewest && above[k] >= kFewest;
    if (!known_[k]) equations.score[row] = 0;
  }
  return equations;
}

void SensorCurve::MoveBorders(const Eigen::VectorXd& change) {
  for (size_t k = 0; k < kBorders; ++k) {
    const double reach = kNearSigmas * std::sqrt(VarianceAt(borders_[k]));
    borders_[k] += std::clamp(change[static_cast<Eigen::Index>(k)], -reach, reach);
  }
  values_.fill(std::numeric_limits<double>::quiet_NaN());
  for (size_t k = 1; k < kBorders; ++k) {
    if (!Measures(k)) continue;
    values_[k] = 0;
    const Eigen::Vector4d weights = BorderWeights(k);
    for (size_t i = 0; i < 4; ++i) {
      const double weight = weights[static_cast<Eigen::Index>(i)];
      if (weight != 0) values_[k] += weight * borders_[k + i - 2];
    }
  }
  // Borders are scaled as the values; those not seen are between the values.
  const double scale = Complete();
  for (size_t k = 0; k < kBorders; ++k) {
    borders_[k] = known_[k] ? borders_[k] * scale : (values_[k] + values_[k + 1]) / 2;
  }
  Tabulate();
}

bool SensorCurve::Measures(size_t grey) const {
  return grey > 0 && grey < kBorders && known_[grey - 1] && known_[grey];
}

// The value = sum of weights * borders grey - 2 to grey + 1.
Eigen::Vector4d SensorCurve::BorderWeights(size_t grey) const {
  const bool cubic = grey >= 2 && grey + 1 < kBorders && known_[grey - 2] && known_[grey + 1];
  return cubic ? Eigen::Vector4d(-1, 9, 9, -1) / 16 : Eigen::Vector4d(0, 0.5, 0.5, 0);
}

Eigen::VectorXd SensorCurve::KnownBorders() const {
  Eigen::VectorXd known = Eigen::VectorXd::Zero(kBorders);
  for (size_t k = 0; k < kBorders; ++k) {
    if (known_[k]) known[static_cast<Eigen::Index>(k)] = borders_[k];
  }
  return known;
}

Eigen::MatrixXd SensorCurve::ValuesByBorders() const {
  Eigen::MatrixXd by_borders = Eigen::MatrixXd::Zero(kGreys, kBorders);
  for (size_t k = 1; k < kBorders; ++k) {
    if (!Measures(k)) continue;
    const auto row = static_cast<Eigen::Index>(k);
    const Eigen::Vector4d weights = BorderWeights(k);
    for (Eigen::Index i = 0; i < 4; ++i) {
      if (weights[i] != 0) by_borders(row, row - 2 + i) = weights[i];
    }
  }
  return by_borders;
}

}  // namespace plenocal
