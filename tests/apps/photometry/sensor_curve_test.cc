// SPDX-License-Identifier: Apache-2.0
//
// Curve and noise of a sensor from histograms whose expectation is known, and small sweeps.
#include "apps/photometry/response/sensor_curve.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>

#include "apps/photometry/images/image_spline.h"
#include "apps/photometry/response/noise_line.h"
#include "apps/photometry/response/response_fit.h"
#include "apps/photometry/response/rising_values.h"
#include "apps/photometry/response/sum_parts.h"
#include "calib/base/error.h"
#include "calib/base/statistics.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
using Values = ResponseCurve::Table;

double Below(double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); }
double Density(double x) { return std::exp(-x * x / 2) / std::sqrt(2 * std::numbers::pi); }

TEST(NoiseLine, IsTheWeightedLeastSquaresLine) {
  NoiseLine line;
  EXPECT_FALSE(line.IsDetermined());
  line.Add(2, 10, 3);
  EXPECT_FALSE(line.IsDetermined());
  line.Add(1, 20, 5);
  ASSERT_TRUE(line.IsDetermined());
  EXPECT_NEAR(line.Gain(), 0.2, 1e-12);
  EXPECT_NEAR(line.ReadVariance(), 1, 1e-12);
  line.Add(4, 40, 8);
  // By the normal equations of rows sqrt(w) (x, 1).
  Eigen::MatrixXd A(3, 2);
  A << std::sqrt(2) * 10, std::sqrt(2), 20, 1, 80, 2;
  const Eigen::Vector3d b(std::sqrt(2) * 3, 5, 16);
  const Eigen::Vector2d x = (A.transpose() * A).inverse() * A.transpose() * b;
  EXPECT_NEAR(line.Gain(), x[0], 1e-9);
  EXPECT_NEAR(line.ReadVariance(), x[1], 1e-9);
  EXPECT_NEAR(line.GainAlone(), A.col(0).dot(b) / A.col(0).squaredNorm(), 1e-12);
  EXPECT_NEAR(line.ReadVarianceAlone(), (2 * 3 + 5 + 4 * 8) / 7.0, 1e-12);
  NoiseLine equal;
  equal.Add(1, 4, 1), equal.Add(3, 4, 2);
  EXPECT_FALSE(equal.IsDetermined());
}

TEST(SumParts, AddsAllPartsWhateverTheThreads) {
  for (const int threads : {1, 3}) {
    EXPECT_EQ(SumParts(0.0,
                       threads,
                       [](size_t part, double* sum) { *sum += static_cast<double>(part * part); }),
              1240);
    EXPECT_EQ(SumParts(1.0, threads, [](size_t, double* sum) { *sum += 2; }), 48);
  }
}

TEST(LightHistogram, HasBinsThatAreEvenInTheSquareRoot) {
  constexpr double kMost = 1.3 * 255;
  EXPECT_EQ(LightHistogram::BinOf(0), 0u);
  EXPECT_EQ(LightHistogram::BinOf(kMost / 4), 1024u);
  EXPECT_EQ(LightHistogram::BinOf(kMost * 0.999999), 2047u);
  for (const size_t bin : {0, 1, 700, 2047}) {
    EXPECT_NEAR(LightHistogram::LightOf(bin),
                kMost * std::pow((static_cast<double>(bin) + 0.5) / 2048, 2),
                1e-9);
    EXPECT_EQ(LightHistogram::BinOf(LightHistogram::LightOf(bin)), bin);
  }
  EXPECT_TRUE(LightHistogram::Holds(0) && LightHistogram::Holds(kMost - 1e-6));
  EXPECT_FALSE(LightHistogram::Holds(-1e-9) || LightHistogram::Holds(kMost));
  LightHistogram a, b;
  a.Add(100, 0.5, 99);
  a.Add(100.001, 0.25, 101);
  b.Add(100, 2, 99);
  a += b;
  const size_t bin = LightHistogram::BinOf(100);
  EXPECT_EQ(a.pixels[bin], 3);
  EXPECT_NEAR(a.light[bin], 300.001, 1e-9);
  EXPECT_EQ(a.variance[bin], 2.75);
  EXPECT_EQ(a.count[bin * 256 + 99], 2u);
  EXPECT_EQ(a.count[bin * 256 + 101], 1u);
}

TEST(SensorCurve, StartsAsAStraightLineWithTheNoiseOfMostSensors) {
  const SensorCurve curve;
  for (const size_t k : {0, 1, 100, 255}) {
    EXPECT_NEAR(curve.Values()[k], static_cast<double>(k), 1e-9);
    EXPECT_NEAR(curve.Middle(k), static_cast<double>(k), 1e-9);
    EXPECT_FALSE(curve.Measures(k));
  }
  EXPECT_DOUBLE_EQ(curve.Noise().gain, 0.0255);
  EXPECT_EQ(curve.Noise().read, 0.5);
  EXPECT_TRUE(curve.KnownBorders().isZero() && curve.ValuesByBorders().isZero());
  const auto variance = [](double u) { return 0.0255 * u + 0.25 + 1 / 12.0; };
  for (const double u : {1.0, 60.0, 200.0, 255.0})
    EXPECT_NEAR(curve.VarianceAt(u), variance(u), 0.01);
  EXPECT_EQ(curve.VarianceAt(300), curve.VarianceAt(255));
  EXPECT_EQ(curve.VarianceAt(-1), curve.VarianceAt(0));
  // Within four standard deviations of darkness or saturation noise is cut off.
  const double bright = 254.5 - 4 * std::sqrt(variance(254.5));
  EXPECT_TRUE(curve.MeasuresWithoutBias(bright - 0.01));
  EXPECT_FALSE(curve.MeasuresWithoutBias(bright + 0.01));
  double dark = 1;
  for (int i = 0; i < 50; ++i) dark = 4 * std::sqrt(variance(dark));
  EXPECT_FALSE(curve.MeasuresWithoutBias(dark - 0.05));
  EXPECT_TRUE(curve.MeasuresWithoutBias(dark + 0.05));
}

TEST(SensorCurve, TakesValuesFillsThoseNotSeenAndScalesAll) {
  Values values, weights;
  for (size_t k = 0; k < 256; ++k) values[k] = 3 + 0.5 * static_cast<double>(k);
  values[100] = kNaN;
  values[50] = values[49] - 2;
  weights.fill(1);
  weights[50] = 0;
  SensorCurve curve;
  curve.SetValues(values, weights);
  const double scale = 255 / 130.5;
  EXPECT_EQ(curve.Values()[0], 0);
  EXPECT_NEAR(curve.Values()[200], 103 * scale, 1e-9);
  EXPECT_NEAR(curve.Values()[100], 53 * scale, 1e-9);
  EXPECT_NEAR(curve.Values()[49], 27.5 * scale, 1e-3);  // the one without weight follows
  EXPECT_GT(curve.Values()[50], curve.Values()[49]);
  EXPECT_NEAR(curve.Middle(200), 103 * scale, 1e-9);
  EXPECT_EQ(curve.Values()[255], 255);
}

// What a sensor with these borders sees: many pixels of each light, by probability.
LightHistogram Expected(
    const std::vector<double>& borders, double gain, double read, double from, double to) {
  LightHistogram histogram;
  constexpr double kPixels = 4000;
  for (size_t bin = LightHistogram::BinOf(from); bin < LightHistogram::BinOf(to); ++bin) {
    const double u = LightHistogram::LightOf(bin), sigma = std::sqrt(gain * u + read * read);
    const double skewness = gain * gain * u / std::pow(sigma, 3);
    const auto below = [&](double border) {
      const double x = (border - u) / sigma;
      return Below(x) - skewness / 6 * (x * x - 1) * Density(x);
    };
    double last = 0;
    for (size_t k = 0; k < 256; ++k) {
      const double share = k < 255 ? std::max(below(borders[k]), last) : 1;
      const auto count =
          static_cast<std::uint32_t>(std::lround(kPixels * share) - std::lround(kPixels * last));
      histogram.count[bin * 256 + k] = count;
      histogram.pixels[bin] += count;
      last = share;
    }
    histogram.light[bin] = histogram.pixels[bin] * u;
  }
  return histogram;
}

std::vector<double> Curved() {
  std::vector<double> borders;
  for (int k = 0; k < 255; ++k) borders.push_back(255 * std::pow((k + 0.5) / 255, 1.3));
  return borders;
}

TEST(SensorCurve, FindsBordersAndNoiseOfASensor) {
  const std::vector<double> borders = Curved();
  const LightHistogram histogram = Expected(borders, 0.05, 0.8, 0.01, 280);
  SensorCurve curve;
  Values start, weights;
  for (size_t k = 0; k < 256; ++k)
    start[k] = 255 * std::pow(static_cast<double>(k) / 255, 1.3) + (k > 0 && k < 255 ? 0.3 : 0);
  weights.fill(1);
  curve.SetValues(start, weights);
  for (int i = 0; i < 12; ++i) {
    const BorderEquations equations = curve.Linearise(histogram);
    curve.MoveBorders(equations.score.cwiseQuotient(equations.information.cwiseMax(1e-300)));
  }
  const Eigen::VectorXd found = curve.KnownBorders();
  // The factor of all light is open: grey value 255 is light 255.
  double factor = 0, count = 0;
  for (int k = 20; k < 250; ++k) factor += found[k] / borders[static_cast<size_t>(k)], count += 1;
  factor /= count;
  EXPECT_NEAR(factor, 1, 0.003);
  for (int k = 3; k < 252; ++k) {
    ASSERT_TRUE(curve.IsKnown(static_cast<size_t>(k))) << k;
    EXPECT_NEAR(found[k] / factor, borders[static_cast<size_t>(k)], 0.02) << k;
  }
  EXPECT_NEAR(curve.Noise().gain, 0.05, 0.002);
  EXPECT_NEAR(curve.Noise().read, 0.8, 0.05);
  for (const size_t k : {10, 100, 240}) {
    EXPECT_TRUE(curve.Measures(k));
    EXPECT_NEAR(
        curve.Values()[k] / factor, 255 * std::pow(static_cast<double>(k) / 255, 1.3), 0.02);
    EXPECT_NEAR(
        curve.Middle(k), (found[static_cast<int>(k) - 1] + found[static_cast<int>(k)]) / 2, 1e-9);
  }
  EXPECT_FALSE(curve.Measures(0) || curve.Measures(255));
  // Values by borders: cubic between four, or the mean of two.
  const Eigen::MatrixXd T = curve.ValuesByBorders();
  EXPECT_LT((T.row(100).segment(98, 4) - Eigen::RowVector4d(-1, 9, 9, -1) / 16).norm(), 1e-12);
  EXPECT_NEAR((T * found)[100], curve.Values()[100], 1e-9);
  EXPECT_NEAR(T.row(100).cwiseAbs().sum(), 20 / 16.0, 1e-12);
}

TEST(SensorCurve, LinearisesTheCountsBelowEachBorder) {
  std::vector<double> borders;
  for (int k = 0; k < 255; ++k) borders.push_back(k + 0.7);
  SensorCurve curve;
  const LightHistogram histogram = Expected(borders, 0.03, 0.7, 60, 130);
  const BorderEquations equations = curve.Linearise(histogram);
  const SensorNoise noise = curve.Noise();
  // All sums again, over borders within five standard deviations.
  Eigen::VectorXd score = Eigen::VectorXd::Zero(255), information = score;
  for (size_t bin = 0; bin < LightHistogram::kBins; ++bin) {
    const double n = histogram.pixels[bin];
    if (n == 0) continue;
    const double u = histogram.light[bin] / n,
                 sigma = std::sqrt(noise.gain * u + noise.read * noise.read);
    EXPECT_NEAR(equations.bins[bin].sigma, sigma, 1e-9);
    const double skewness = noise.gain * noise.gain * u / std::pow(sigma, 3);
    double below = 0;
    for (size_t k = 0; k < 255; ++k) {
      below += histogram.count[bin * 256 + k];
      const double x = (static_cast<double>(k) + 0.5 - u) / sigma;
      const bool near = std::abs(x) < 5;
      EXPECT_EQ(near, k >= equations.bins[bin].first && k < equations.bins[bin].end);
      if (!near) continue;
      const double distribution = Below(x) - skewness / 6 * (x * x - 1) * Density(x);
      EXPECT_NEAR(equations.density[bin * 255 + k], Density(x), 1e-6);
      EXPECT_NEAR(equations.distribution[bin * 255 + k], distribution, 1e-6);
      score[static_cast<int>(k)] += Density(x) * (below - n * distribution);
      information[static_cast<int>(k)] += n * Density(x) * Density(x) / sigma;
    }
  }
  EXPECT_LT((equations.information - information).norm(), 1e-6 * information.norm());
  for (int k = 0; k < 255; ++k) {
    EXPECT_NEAR(equations.score[k],
                curve.IsKnown(static_cast<size_t>(k)) ? score[k] : 0,
                1e-4 * score.norm());
  }
  EXPECT_FALSE(curve.IsKnown(20) || curve.IsKnown(200));
  EXPECT_TRUE(curve.IsKnown(100));
  EXPECT_EQ(curve.KnownBorders()[20], 0);
  // Borders move by at most five standard deviations; those not seen lie between the values.
  const double reach = 5 * std::sqrt(curve.VarianceAt(100.5));
  Eigen::VectorXd change = Eigen::VectorXd::Zero(255);
  change[100] = 1e6, change[20] = 1;
  SensorCurve moved = curve;
  moved.MoveBorders(change);
  const double ratio = moved.KnownBorders()[90] / 90.5;
  EXPECT_NEAR(moved.KnownBorders()[100], ratio * (100.5 + reach), 1e-6);
  EXPECT_NEAR(moved.Middle(20),
              (moved.Values()[19] + 2 * moved.Values()[20] + moved.Values()[21]) / 4,
              1e-6);
}

// A bin at light u: n pixels, half of them `apart` above the grey value, half below.
void AddLight(double u, int n, int apart, double error_variance, LightHistogram* histogram) {
  for (int i = 0; i < n; ++i)
    histogram->Add(u,
                   error_variance,
                   static_cast<std::uint8_t>(std::lround(u) + (i % 2 == 0 ? apart : -apart)));
}

TEST(SensorCurve, FitsTheVarianceOfGreyValuesByALineOverTheLight) {
  struct Light {
    double u;
    int n, apart;
    double error_variance;
  };
  const auto fit = [](const std::vector<Light>& lights) {
    LightHistogram histogram;
    for (const auto& [u, n, apart, error] : lights) AddLight(u, n, apart, error, &histogram);
    SensorCurve curve;
    curve.Linearise(histogram);
    return curve.Noise();
  };
  const SensorCurve start;
  // Weighted least squares; few pixels, and light whose noise is cut off, do not count.
  const auto line = [&](const std::vector<Light>& lights, bool slope, bool offset) {
    Eigen::Matrix2d N = Eigen::Matrix2d::Zero();
    Eigen::Vector2d b = Eigen::Vector2d::Zero();
    for (const auto& [u, n, apart, error] : lights) {
      if (n < 30 || u < 5 || u > 240) continue;
      const double assumed = start.VarianceAt(u), width = 2 * std::sqrt(u * 1.3 * 255) / 2048;
      const double variance =
          apart * apart - (assumed - 0.0255 * u - 0.25) - error - width * width / 12;
      const Eigen::Vector2d J(slope ? u : 0, offset ? 1 : 0);
      N += n / (assumed * assumed) * J * J.transpose();
      b += n / (assumed * assumed) * J * variance;
    }
    if (!slope) N(0, 0) = 1;
    if (!offset) N(1, 1) = 1;
    return Eigen::Vector2d(N.inverse() * b);
  };
  const std::vector<Light> rising{{40.2, 30, 3, 0.7},
                                  {80.1, 50, 3, 0.3},
                                  {150.3, 90, 4, 2.5},
                                  {120.4, 29, 9, 0},
                                  {2.1, 100, 2, 0},
                                  {251.4, 100, 3, 0}};
  const Eigen::Vector2d expected = line(rising, true, true);
  EXPECT_TRUE(expected[0] > 0 && expected[1] > 0) << expected;
  EXPECT_NEAR(fit(rising).gain, expected[0], 1e-9);
  EXPECT_NEAR(fit(rising).read, std::sqrt(expected[1]), 1e-9);
  const std::vector<Light> falling{{40.2, 40, 4, 0}, {80.1, 50, 3, 0}, {150.3, 90, 2, 0}};
  EXPECT_LT(line(falling, true, true)[0], 0);
  EXPECT_EQ(fit(falling).gain, 0);
  EXPECT_NEAR(fit(falling).read, std::sqrt(line(falling, false, true)[1]), 1e-9);
  const std::vector<Light> steep{{40.2, 40, 1, 0}, {80.1, 50, 2, 0}, {150.3, 90, 4, 0}};
  EXPECT_LT(line(steep, true, true)[1], 0);
  EXPECT_NEAR(fit(steep).gain, line(steep, true, false)[0], 1e-9);
  EXPECT_EQ(fit(steep).read, 0);
  const SensorNoise one = fit({{40.2, 40, 4, 0}});
  EXPECT_EQ(one.gain, 255 / 1e4);
  EXPECT_EQ(one.read, 0.5);
}

TEST(SensorCurve, KnowsBordersWithTwentyPixelsOnBothSides) {
  LightHistogram histogram;
  const auto add = [&](int grey, int count) {
    for (int i = 0; i < count; ++i) histogram.Add(101.3, 0, static_cast<std::uint8_t>(grey));
  };
  add(99, 19), add(100, 1), add(101, 5), add(102, 1), add(103, 19);
  SensorCurve curve;
  curve.Linearise(histogram);
  for (size_t k = 0; k < 255; ++k) EXPECT_EQ(curve.IsKnown(k), k == 100 || k == 101) << k;
  EXPECT_TRUE(curve.Measures(101));
  EXPECT_FALSE(curve.Measures(100) || curve.Measures(102));
}

TEST(SensorCurve, MovesValuesWithTheBordersAboutThem) {
  std::vector<double> borders;
  for (int k = 0; k < 255; ++k) borders.push_back(k + 0.5);
  SensorCurve curve;
  curve.Linearise(Expected(borders, 0.03, 0.5, 0.05, 12));
  ASSERT_TRUE(curve.IsKnown(0) && curve.IsKnown(1) && curve.IsKnown(8));
  ASSERT_FALSE(curve.IsKnown(30));
  Eigen::VectorXd change = Eigen::VectorXd::Zero(255);
  change[0] = 0.3, change[5] = -0.2, change[7] = 0.1, change[30] = 0.2;
  curve.MoveBorders(change);
  const double scale = curve.KnownBorders()[2] / 2.5;
  EXPECT_NEAR(curve.KnownBorders()[0], 0.8 * scale, 1e-9);
  EXPECT_NEAR(curve.KnownBorders()[5], 5.3 * scale, 1e-9);
  EXPECT_EQ(curve.Values()[0], 0);
  EXPECT_NEAR(curve.Values()[1], (0.8 + 1.5) / 2 * scale, 1e-9);
  EXPECT_NEAR(curve.Values()[2], (-0.8 + 9 * 1.5 + 9 * 2.5 - 3.5) / 16 * scale, 1e-9);
  EXPECT_NEAR(curve.Values()[6], (-4.5 + 9 * 5.3 + 9 * 6.5 - 7.6) / 16 * scale, 1e-9);
  EXPECT_NEAR(curve.Middle(6), (5.3 + 6.5) / 2 * scale, 1e-9);
  EXPECT_EQ(curve.Values()[255], 255);
  // Values by borders, up to the factor.
  const Eigen::MatrixXd T = curve.ValuesByBorders();
  const Eigen::VectorXd values = T * curve.KnownBorders();
  for (size_t k = 0; k < 256; ++k) {
    const auto row = static_cast<int>(k);
    EXPECT_NEAR(values[row], curve.Measures(k) ? curve.Values()[k] : 0, 1e-9);
    EXPECT_NEAR(T.row(row).sum(), curve.Measures(k) ? 1 : 0, 1e-12);
  }
  EXPECT_EQ(T(1, 0), 0.5);
  EXPECT_EQ(T(2, 0), -1 / 16.0);
}

TEST(RisingValues, FillGapsByTheirFormulas) {
  Values values;
  values.fill(kNaN);
  // Slopes 1 to 20, then 2 to 40, then none to 60, then 3.
  values[10] = 10, values[20] = 20, values[40] = 60, values[60] = 60, values[80] = 120;
  FillGaps(values);
  const auto hermite = [](double a, double b, double at_a, double at_b, double width, double t) {
    return a * (1 + 2 * t) * std::pow(1 - t, 2) + b * t * t * (3 - 2 * t) +
           width * (at_a * t * std::pow(1 - t, 2) - at_b * t * t * (1 - t));
  };
  const double harmonic = 2 * 1 * 2 / 3.0;
  for (const double t : {0.1, 0.5, 0.9}) {
    EXPECT_NEAR(
        values[static_cast<size_t>(10 + 10 * t)], hermite(10, 20, 1, harmonic, 10, t), 1e-9);
  }
  for (const double t : {0.25, 0.75}) {
    EXPECT_NEAR(
        values[static_cast<size_t>(20 + 20 * t)], hermite(20, 60, harmonic, 0, 20, t), 1e-9);
    EXPECT_NEAR(values[static_cast<size_t>(40 + 20 * t)], 60, 1e-9);
    EXPECT_NEAR(values[static_cast<size_t>(60 + 20 * t)], hermite(60, 120, 0, 3, 20, t), 1e-9);
  }
  // Beyond by the line over three values.
  const double first = (values[13] - 10) / 3, last = (120 - values[77]) / 3;
  EXPECT_NEAR(values[9], 10 - first, 1e-9);
  EXPECT_NEAR(values[0], 10 - 10 * first, 1e-9);
  EXPECT_NEAR(values[81], 120 + last, 1e-9);
  EXPECT_NEAR(values[255], 120 + 175 * last, 1e-9);
  Values two;
  two.fill(kNaN);
  two[7] = 1, two[9] = 2;
  FillGaps(two);
  for (size_t k = 0; k < 256; ++k)
    EXPECT_NEAR(two[k], 1 + 0.5 * (static_cast<double>(k) - 7), 1e-9);
}

TEST(RisingValues, PoolByWeightWithLeastSteps) {
  Values values, weights;
  std::iota(values.begin(), values.end(), 0.0);
  weights.fill(1);
  values[100] = 104, values[101] = 101, values[102] = 96, values[103] = 103;
  weights[100] = 2;
  weights[200] = 0;
  values[200] = 190;
  MakeRising(values, weights);
  const double pooled = (2 * 104 + 101 + 96) / 4.0, step = 255e-6;
  EXPECT_NEAR(values[100], pooled, 1e-9);
  EXPECT_NEAR(values[101], pooled + step, 1e-9);
  EXPECT_NEAR(values[102], pooled + 2 * step, 1e-9);
  EXPECT_EQ(values[103], 103);
  EXPECT_NEAR(values[199], 199, 1e-5);
  EXPECT_NEAR(values[200], 199 + step, 1e-5);
  EXPECT_NEAR(values[198], 198, 1e-5);
}

TEST(ImageSpline, IsTheSplineOfItsCoefficientsUpToTheBorders) {
  const ImageSpline spline({20, 10}, 7);  // 3 x 2 cells
  EXPECT_EQ(spline.Columns(), 6);
  EXPECT_EQ(spline.Coefficients(), 30);
  EXPECT_EQ(MakeAttenuationSpline({160, 28}).Coefficients(), 43 * 10);
  EXPECT_EQ(MakeAttenuationSpline({28, 160}).Coefficients(), 43 * 10);
  // A coefficient's spline by convolution: B(t) at distance |t| cells.
  const auto bspline = [](double t) {
    t = std::abs(t);
    return t < 1 ? 2.0 / 3 - t * t + t * t * t / 2 : t < 2 ? std::pow(2 - t, 3) / 6 : 0;
  };
  for (const int index : {0, 8, 15, 29}) {
    Eigen::VectorXd coefficients = Eigen::VectorXd::Zero(30);
    coefficients[index] = 1;
    for (const auto& [x, y] :
         {std::pair{-0.5, -0.5}, {0.0, 9.0}, {6.2, 4.4}, {12.9, 3.3}, {19.5, 9.5}}) {
      const double u = (x + 0.5) * 3 / 20 - (index % 6 - 1),
                   v = (y + 0.5) * 2 / 10 - (index / 6 - 1);
      EXPECT_NEAR(spline.Evaluate(coefficients, x, y), bspline(u) * bspline(v), 1e-6);
    }
  }
  // Variance and solution of a fit by the normal equations.
  SplineFit fit(spline);
  Eigen::MatrixXd N = Eigen::MatrixXd::Zero(30, 30);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(30);
  const auto row = [&](double x, double y) {
    Eigen::VectorXd J = Eigen::VectorXd::Zero(30);
    const ImageSpline::Basis basis = spline.At(x, y);
    for (size_t k = 0; k < 16; ++k) J[basis.index[k]] = basis.weight[k];
    return J;
  };
  for (int i = 0; i < 60; ++i) {
    const double x = 19 * std::fmod(0.37 * i, 1), y = 9 * std::fmod(0.61 * i, 1),
                 value = std::sin(i), weight = 1 + i % 3;
    fit.Add(x, y, value, weight);
    N += weight * row(x, y) * row(x, y).transpose();
    b += weight * value * row(x, y);
  }
  const double bend = 1e-4 * N.diagonal().mean();
  const auto add = [&](int first, int step) {
    Eigen::VectorXd J = Eigen::VectorXd::Zero(30);
    J[first] = J[first + 2 * step] = 1, J[first + step] = -2;
    return Eigen::MatrixXd(bend * J * J.transpose());
  };
  Eigen::MatrixXd bent = N;
  for (int i = 0; i < 30; ++i) {
    if (i % 6 < 4) bent += add(i, 1);
    if (i < 18) bent += add(i, 6);
  }
  EXPECT_LT((bent * fit.Solve() - b).norm(), 1e-8);
  EXPECT_LT((bent * fit.Covariance() - Eigen::MatrixXd::Identity(30, 30)).norm(), 1e-6);
  EXPECT_NEAR(VarianceAt(spline.At(7, 3), fit.Covariance()),
              row(7, 3).dot(bent.inverse() * row(7, 3)),
              1e-6);
  const Eigen::VectorXd coefficients = fit.Solve();
  const cv::Mat attenuation = MakeAttenuation(spline, coefficients, {20, 10}, 2);
  double most = -1e9;
  for (int i = 0; i < 200; ++i)
    most = std::max(most, spline.Evaluate(coefficients, i % 20, i / 20));
  for (int i = 0; i < 200; i += 7) {
    EXPECT_NEAR(attenuation.at<float>(i / 20, i % 20),
                std::exp(spline.Evaluate(coefficients, i % 20, i / 20) - most),
                1e-5);
  }
}

// Few pixels of few images, with the exposures' errors and a moving part.
ExposureSweep SmallSweep(double least = 0.1, double most = 12, double moving = 0) {
  constexpr size_t kImages = 26, kPixels = 700;
  std::mt19937_64 engine(5);
  std::normal_distribution<double> normal;
  ExposureSweep sweep;
  for (size_t i = 0; i < kImages; ++i) {
    const double t = least * std::pow(most / least, static_cast<double>(i) / (kImages - 1));
    const double error = 0.01 * std::sin(1.7 * static_cast<double>(i));
    sweep.frames.push_back(std::to_string(i));
    sweep.exposures.push_back(t);
    std::vector<std::uint8_t> grey;
    std::vector<bool> beside;
    for (size_t x = 0; x < kPixels; ++x) {
      const double bright = (0.03 + 0.1 * static_cast<double>(x) / kPixels) *
                            (x % 50 == 7 && i > 12 ? 1.3 : 1) *
                            (x % 4 > 0 ? 1 + moving * std::sin(static_cast<double>(x * i)) : 1);
      const double mean = t * (1 + error) * bright;
      const double level =
          std::clamp(mean + normal(engine) * std::sqrt(mean / 10000 + 1e-6), 0.0, 1.0);
      grey.push_back(static_cast<std::uint8_t>(std::lround(255 * std::pow(level, 1 / 1.6))));
      beside.push_back(x % 97 == 5 && i > 20);
    }
    sweep.grey.push_back(grey);
    sweep.beside_saturated.push_back(beside);
  }
  return sweep;
}

TEST(SmallResponse, IsThatOfTheSensorWithItsExposuresAndNoise) {
  const ExposureSweep sweep = SmallSweep();
  const ResponseEstimate found = FitResponse(sweep, "here", 2);
  double scale = 0, norm = 0;
  for (size_t k = 20; k < 250; ++k) {
    const double truth = 255 * std::pow(static_cast<double>(k) / 255, 1.6);
    scale += truth * found.curve.Light(k), norm += std::pow(found.curve.Light(k), 2);
  }
  for (size_t k = 20; k < 250; ++k) {
    EXPECT_NEAR(
        scale / norm * found.curve.Light(k), 255 * std::pow(static_cast<double>(k) / 255, 1.6), 1.5)
        << k;
  }
  EXPECT_NEAR(found.noise.gain, 0.0255, 0.004);
  EXPECT_NEAR(found.noise.read, 0.255, 0.08);
  EXPECT_TRUE(found.exposure_sigma > 0.004 && found.exposure_sigma < 0.012) << found.exposure_sigma;
  EXPECT_EQ(found.moving + found.pixels, 700u);
  EXPECT_NEAR(static_cast<double>(found.moving), 14, 3);
  EXPECT_EQ(std::accumulate(found.count.begin(), found.count.end(), size_t{0}), 26 * found.pixels);
  for (size_t i = 5; i < 20; ++i) {
    EXPECT_NEAR(found.exposure_errors[i], 0.01 * std::sin(1.7 * static_cast<double>(i)), 0.006)
        << i;
  }
}

// The order of images and pixels and the unit of exposures do not matter.
TEST(SmallResponse, IsTheSameInAnyOrderAndUnit) {
  const ExposureSweep sweep = SmallSweep();
  constexpr size_t kImages = 26;
  const auto image = [](size_t i) { return (7 * i + 11) % kImages; };
  ExposureSweep mixed;
  for (size_t i = 0; i < kImages; ++i) {
    const size_t from = image(i);
    mixed.frames.push_back(sweep.frames[from]);
    mixed.exposures.push_back(4 * sweep.exposures[from]);
    mixed.grey.emplace_back(sweep.grey[from].rbegin(), sweep.grey[from].rend());
    mixed.beside_saturated.emplace_back(sweep.beside_saturated[from].rbegin(),
                                        sweep.beside_saturated[from].rend());
  }
  const ResponseEstimate found = FitResponse(sweep, "here", 2),
                         other = FitResponse(mixed, "here", 1);
  constexpr double kSame = 1e-5;
  for (size_t k = 0; k < 256; ++k) {
    EXPECT_NEAR(other.curve.Light(k), found.curve.Light(k), kSame) << k;
    EXPECT_EQ(other.count[k], found.count[k]);
    EXPECT_EQ(std::isnan(found.sigma[k]),
              static_cast<int>(k) <= found.first || static_cast<int>(k) >= found.last);
    if (!std::isnan(found.sigma[k])) {
      EXPECT_NEAR(other.sigma[k] / found.sigma[k], 1, 10 * kSame);
    }
  }
  EXPECT_EQ(found.curve.Light(0), 0);
  EXPECT_NEAR(other.noise.gain / found.noise.gain, 1, kSame);
  EXPECT_NEAR(other.noise.read / found.noise.read, 1, kSame);
  EXPECT_NEAR(other.exposure_sigma / found.exposure_sigma, 1, kSame);
  EXPECT_NEAR(other.rms / found.rms, 1, kSame);
  EXPECT_EQ(other.pixels, found.pixels);
  EXPECT_EQ(other.moving, found.moving);
  EXPECT_EQ(other.first, found.first);
  EXPECT_EQ(other.last, found.last);
  // An exponent of the exposures is that of the response: it is left as recorded.
  double along = 0, squares = 0, exponents = 0;
  ASSERT_EQ(found.exposure_errors.size(), kImages);
  for (size_t i = 0; i < kImages; ++i) {
    EXPECT_NEAR(other.exposure_errors[i], found.exposure_errors[image(i)], kSame);
    const double x = std::log1p(found.exposure_errors[i]);
    const double exponent = std::log(sweep.exposures[i] / std::sqrt(0.1 * 12));
    along += x * exponent, squares += x * x, exponents += exponent * exponent;
  }
  EXPECT_LT(std::abs(along) / std::sqrt(squares * exponents), 1e-3);
}

TEST(SmallResponse, IsRefusedWithTheRemedy) {
  const auto refuse = [](const ExposureSweep& sweep) -> std::string {
    return RefusalOf([&] { FitResponse(sweep, "here", 1); }, ErrorKind::kJob);
  };
  EXPECT_EQ(
      refuse(SmallSweep(0.1, 0.199)),
      "here: exposures are from 0.1 to 0.199 ms; a response needs a static scene at exposures that differ by a factor "
      "of 10 or more");
  ExposureSweep sweep = SmallSweep();
  const auto fill = [&](std::uint8_t value, size_t images) {
    ExposureSweep filled = sweep;
    for (size_t i = 0; i < 26; ++i) std::ranges::fill(filled.grey[i], i < images ? value : 128);
    return filled;
  };
  EXPECT_EQ(refuse(fill(255, 25)),
            "here: 96 % of the pixels are saturated; use shorter exposures or less light");
  EXPECT_EQ(refuse(fill(0, 25)),
            "here: 96 % of the pixels are black; use longer exposures or more light");
  EXPECT_EQ(
      refuse(SmallSweep(0.1, 12, 0.2)),
      "here: in most pixels the light is not proportional to the exposure; the camera and the scene must stand still, the "
      "gain must be fixed and the lamp must not flicker");
  // Two brightnesses alone: few borders are seen.
  ExposureSweep poor = sweep;
  for (auto& image : poor.grey) {
    for (size_t x = 0; x < image.size(); ++x) image[x] = image[x] < 100 ? 3 : 200;
  }
  EXPECT_EQ(
      refuse(poor),
      "here: only 0 of 255 borders between grey values were seen; use a scene with dark and bright parts and more "
      "exposures between them");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
