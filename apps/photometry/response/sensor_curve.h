// SPDX-License-Identifier: Apache-2.0
//
// Curve and noise of a sensor while they are fitted. The borders b_k between grey values are
// estimated by ordered probit regression with a sigma that depends on the light:
// P(I <= k) = Phi((b_k - light) / sigma) (McCullagh, "Regression Models for Ordinal Data", 1980).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "detectors/photometry/response_curve.h"

namespace plenocal {

inline double SquareOf(double x) { return x * x; }

/// Variance of the light of one pixel: gain * light + read^2, light from 0 to 255; rounding to grey
/// values comes in addition.
struct SensorNoise {
  double gain = 0;  ///< 255 / electrons of a full pixel
  double read = 0;  ///< standard deviation
};

/// How often each grey value was seen at each light. Bins are even in the light's square root, so
/// that each is as wide, in standard deviations of shot noise, as any other.
struct LightHistogram {
  static constexpr std::size_t kBins = 2048;
  static constexpr double kMostLight = 1.3 * 255;  // sensors are full below
  std::vector<std::uint32_t> count =
      std::vector<std::uint32_t>(kBins * ResponseCurve::kValues);  ///< by bin, then grey value
  std::vector<double> pixels = std::vector<double>(kBins);         ///< of all grey values
  std::vector<double> light = std::vector<double>(kBins);          ///< sum
  std::vector<double> variance = std::vector<double>(kBins);       ///< sum, of the light's error

  static std::size_t BinOf(double u);
  static double LightOf(std::size_t bin);
  static bool Holds(double u) { return u >= 0 && u < kMostLight; }
  void Add(double u, double error_variance, std::uint8_t grey);
  LightHistogram& operator+=(const LightHistogram& other);
};

/// Estimating equations of the borders, linear at the present ones: score = 0 with
/// score_k = sum of phi(x) (1 if I <= k, else 0, - P(noise < x sigma)) over pixels. Beside
/// likelihood's equations they lack 1 / (Phi (1 - Phi)), which gives the weight to far tails, where
/// a small error of sigma decides.
struct BorderEquations {
  /// A bin of the histogram, the borders near it, and its pixels' noise without rounding, which is
  /// what borders describe.
  struct Bin {
    std::size_t first = 0, end = 0;
    double sigma = 1;
  };
  std::vector<Bin> bins = std::vector<Bin>(LightHistogram::kBins);
  std::vector<float> density, distribution;  ///< by bin, then border
  Eigen::VectorXd score, information;        ///< information: -d score / d border
};

class SensorCurve {
 public:
  static constexpr std::size_t kGreys = ResponseCurve::kValues;
  static constexpr std::size_t kBorders = kGreys - 1;
  using Table = ResponseCurve::Table;

  /// A straight line, with the noise of most sensors.
  SensorCurve();
  /// Borders between the values; those that are NaN are filled.
  void SetValues(const Table& values, const Table& weights);
  /// Noise and the known borders by the histogram, then the equations of these.
  BorderEquations Linearise(const LightHistogram& histogram);
  void MoveBorders(const Eigen::VectorXd& change);

  [[nodiscard]] const Table& Values() const { return values_; }
  [[nodiscard]] const SensorNoise& Noise() const { return noise_; }
  [[nodiscard]] bool IsKnown(std::size_t border) const { return known_[border]; }
  /// Both borders of the grey value are known.
  [[nodiscard]] bool Measures(std::size_t grey) const;
  /// Borders; 0 where they are not known.
  [[nodiscard]] Eigen::VectorXd KnownBorders() const;
  /// d values / d borders; rows of values that are not measured are 0.
  [[nodiscard]] Eigen::MatrixXd ValuesByBorders() const;
  /// The mean light of a grey value.
  [[nodiscard]] double Middle(std::size_t grey) const { return middles_[grey]; }
  /// Variance of the light of one pixel by its grey value, rounding included.
  [[nodiscard]] double VarianceAt(double u) const;
  /// Neither darkness nor saturation cuts off the noise of such light.
  [[nodiscard]] bool MeasuresWithoutBias(double u) const { return u < brightest_ && u > darkest_; }

 private:
  [[nodiscard]] double Variance(double u) const;
  [[nodiscard]] Eigen::Vector4d BorderWeights(std::size_t grey) const;
  double Complete();
  void Tabulate();
  void EstimateNoise(const LightHistogram& histogram);

  Table values_;
  std::array<double, kBorders> borders_{};
  std::array<bool, kBorders> known_{};
  SensorNoise noise_{.gain = 255 / 1e4, .read = 0.5};
  // Tables of the above: mean light by grey value, variance by bin of the histogram.
  Table middles_{};
  std::array<double, LightHistogram::kBins> variances_{};
  double brightest_ = 255, darkest_ = 0;
};

}  // namespace plenocal
