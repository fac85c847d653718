// SPDX-License-Identifier: Apache-2.0
//
// The response of a simulated sensor with a known one.
#include "apps/photometry/response/response_fit.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <numeric>
#include <opencv2/core.hpp>
#include <random>

#include "apps/photometry/images/image_spline.h"
#include "apps/photometry/response/rising_values.h"
#include "calib/base/error.h"
#include "tests/apps/workspace.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;

constexpr double kElectrons = 10000, kReadElectrons = 8;

// Light of a grey value; the darkest one is `black`.
double PowerLaw(double grey, double black = 0) {
  return 255 * std::pow(std::max(grey - black, 0.0) / (255 - black), 2.2);
}

struct SweepErrors {
  double gain_step = 1;  // of the second half of the images
  double exposure = 0;   // standard deviation, relative
  double black = 0;      // grey value of darkness
  unsigned seed = 5;
};

// Electrons counted, then the tone curve.
ExposureSweep MakeSweep(size_t images, double most, const SweepErrors& errors = {}) {
  constexpr size_t kPixels = 8000;
  std::mt19937_64 engine(errors.seed);
  std::normal_distribution<double> normal;
  ExposureSweep sweep;
  for (size_t i = 0; i < images; ++i) {
    const double share = static_cast<double>(i) / static_cast<double>(images - 1);
    const double t = 0.1 * std::pow(most, share);
    sweep.frames.push_back(std::to_string(i));
    sweep.exposures.push_back(t);
    const double gain = (2 * i < images ? 1 : errors.gain_step) *
                        (1 + (errors.exposure > 0 ? errors.exposure * normal(engine) : 0));
    std::vector<std::uint8_t> grey;
    for (size_t x = 0; x < kPixels; ++x) {
      const double bright = 0.02 + 0.08 * static_cast<double>(x) / kPixels;
      const double mean = kElectrons * t * bright * gain;
      const double electrons =
          mean + normal(engine) * std::sqrt(mean + kReadElectrons * kReadElectrons);
      const double level = std::clamp(electrons / kElectrons, 0.0, 1.0);
      grey.push_back(static_cast<std::uint8_t>(
          std::lround(errors.black + (255 - errors.black) * std::pow(level, 1 / 2.2))));
    }
    sweep.grey.push_back(grey);
    sweep.beside_saturated.emplace_back(kPixels, false);
  }
  return sweep;
}

TEST(ResponseFit, FindsThePowerLawWithinItsStandardDeviations) {
  const ResponseEstimate estimate = FitResponse(MakeSweep(100, 300), "here", 2);
  double scale = 0, norm = 0;
  constexpr size_t kFirst = 5, kLast = 250;
  for (size_t k = kFirst; k <= kLast; ++k) {
    scale += estimate.curve.Light(k) * PowerLaw(static_cast<double>(k));
    norm += std::pow(estimate.curve.Light(k), 2);
  }
  scale /= norm;
  double squares = 0, ratio = 0;
  size_t known = 0;
  for (size_t k = kFirst; k <= kLast; ++k) {
    const double error = scale * estimate.curve.Light(k) - PowerLaw(static_cast<double>(k));
    squares += error * error;
    EXPECT_LT(std::abs(error), 0.005 * 255) << k;
    if (std::isnan(estimate.sigma[k])) continue;
    ratio += std::pow(error / estimate.sigma[k], 2);
    ++known;
  }
  constexpr double kCount = kLast - kFirst + 1;
  EXPECT_LT(std::sqrt(squares / kCount), 0.0005 * 255);
  // Neighbouring values have common errors, so that one run has some 30 independent ones.
  ASSERT_GT(known, 230U);
  EXPECT_GT(ratio / static_cast<double>(known), 0.4);
  EXPECT_LT(ratio / static_cast<double>(known), 1.8);
  EXPECT_NEAR(255 / estimate.noise.gain, kElectrons, 0.05 * kElectrons);
  EXPECT_NEAR(estimate.noise.read / 255 * kElectrons, kReadElectrons, 0.15 * kReadElectrons);
  EXPECT_LT(estimate.exposure_sigma, 0.001);
}

// Mean (error / standard deviation)^2 of dark grey values, over seeds.
double DarkChiSquare(SweepErrors errors) {
  constexpr unsigned kSeeds = 2;
  constexpr size_t kImages = 50, kDarkest = 8, kEnd = 25;
  double sum = 0, count = 0;
  for (errors.seed = 1; errors.seed <= kSeeds; ++errors.seed) {
    const ResponseEstimate estimate = FitResponse(MakeSweep(kImages, 300, errors), "here", 2);
    double scale = 0, norm = 0;
    for (size_t k = 0; k < ResponseCurve::kValues; ++k) {
      if (std::isnan(estimate.sigma[k])) continue;
      scale += estimate.curve.Light(k) * PowerLaw(static_cast<double>(k), errors.black);
      norm += std::pow(estimate.curve.Light(k), 2);
    }
    for (size_t k = kDarkest; k < kEnd; ++k) {
      if (std::isnan(estimate.sigma[k])) continue;
      const double error =
          scale / norm * estimate.curve.Light(k) - PowerLaw(static_cast<double>(k), errors.black);
      sum += std::pow(error / estimate.sigma[k], 2);
      count += 1;
    }
  }
  EXPECT_GT(count, kSeeds * (kEnd - kDarkest) / 2.0);
  return sum / count;
}

TEST(ResponseFit, FindsDarkValuesWithinTheirStandardDeviationsWhereExposuresAreWrong) {
  const double chi_square = DarkChiSquare({.exposure = 0.02});
  EXPECT_GT(chi_square, 0.3);
  EXPECT_LT(chi_square, 2.5);
}

TEST(ResponseFit, FindsDarkValuesWithinTheirStandardDeviationsAboveABlackLevel) {
  const double chi_square = DarkChiSquare({.black = 4});
  EXPECT_GT(chi_square, 0.3);
  EXPECT_LT(chi_square, 2.5);
}

TEST(ResponseFit, LeavesOutGreyValuesBelowTheBlackLevel) {
  const ResponseEstimate estimate = FitResponse(MakeSweep(40, 300, {.black = 16}), "here", 2);
  EXPECT_GE(estimate.first, 16);
  for (size_t k = 0; k <= 16; ++k) EXPECT_TRUE(std::isnan(estimate.sigma[k])) << k;
  EXPECT_FALSE(std::isnan(estimate.sigma[40]));
}

TEST(ResponseFit, RisesStrictlyAndLeavesOutWhatWasNotSeen) {
  const ResponseEstimate estimate = FitResponse(MakeSweep(40, 50), "here", 2);  // 0.1 to 5: dark
  for (size_t k = 1; k < ResponseCurve::kValues; ++k) {
    EXPECT_GT(estimate.curve.Light(k), estimate.curve.Light(k - 1)) << k;
  }
  EXPECT_LT(estimate.last, 220);
  EXPECT_TRUE(std::isnan(estimate.sigma[240]));
  EXPECT_FALSE(std::isnan(estimate.sigma[100]));
}

TEST(ResponseFit, SeesThatTheGainWasNotFixed) {
  const ResponseEstimate estimate = FitResponse(MakeSweep(100, 300, {.gain_step = 1.2}), "here", 2);
  EXPECT_GT(estimate.exposure_sigma, 0.01);
}

TEST(ResponseFit, RefusesEqualExposuresAndSaturation) {
  const auto message = [](const ExposureSweep& sweep) {
    return RefusalOf([&] { FitResponse(sweep, "here", 1); }, ErrorKind::kJob);
  };
  EXPECT_THAT(message(MakeSweep(20, 1.5)), HasSubstr("exposures that differ"));
  ExposureSweep bright = MakeSweep(20, 100);
  for (auto& image : bright.grey) std::ranges::fill(image, 255);
  EXPECT_THAT(message(bright), HasSubstr("saturated; use shorter exposures"));
  for (auto& image : bright.grey) std::ranges::fill(image, 0);
  EXPECT_THAT(message(bright), HasSubstr("black; use longer exposures"));
}

TEST(RisingValues, AreTheNearestThatDoNotFall) {
  ResponseCurve::Table values;
  std::iota(values.begin(), values.end(), 0.0);
  values[10] = 12;
  values[11] = 10;
  std::array<double, ResponseCurve::kValues> weights;
  weights.fill(1);
  weights[10] = 3;
  MakeRising(values, weights);
  EXPECT_NEAR(values[10], 11.5, 1e-3);
  EXPECT_NEAR(values[11], 11.5, 1e-3);
  EXPECT_GT(values[11], values[10]);
  EXPECT_EQ(values[9], 9);
}

TEST(RisingValues, FillGapsWithoutLeavingTheirNeighbours) {
  ResponseCurve::Table values;
  for (size_t k = 0; k < values.size(); ++k) values[k] = PowerLaw(static_cast<double>(k));
  const ResponseCurve::Table truth = values;
  for (size_t k = 100; k < 110; ++k) values[k] = std::numeric_limits<double>::quiet_NaN();
  values[255] = values[254] = std::numeric_limits<double>::quiet_NaN();
  FillGaps(values);
  for (size_t k = 100; k < 110; ++k) EXPECT_NEAR(values[k], truth[k], 0.1) << k;
  EXPECT_NEAR(values[255], truth[255], 0.1);
}

TEST(ImageSpline, HoldsCubicsAndItsWeightsAddUpToOne) {
  const ImageSpline spline({200, 100}, 20);
  SplineFit fit(spline);
  const auto cubic = [](double x, double y) {
    return 1 + 0.01 * x - 1e-6 * x * x * x + 1e-4 * x * y;
  };
  for (int y = 0; y < 100; y += 2) {
    for (int x = 0; x < 200; x += 2) fit.Add(x, y, cubic(x, y), 1e4);
  }
  const Eigen::VectorXd coefficients = fit.Solve();
  for (const double x : {0.0, 33.3, 199.0}) {
    double sum = 0;
    for (const float weight : spline.At(x, 50).weight) sum += weight;
    EXPECT_NEAR(sum, 1, 1e-6);
    // Hardly bent: the weak prior costs some 1e-3 at the border.
    EXPECT_NEAR(spline.Evaluate(coefficients, x, 50), cubic(x, 50), 2e-3);
  }
  // A cell of 20 x 20 px has 100 values of standard deviation 0.01.
  EXPECT_NEAR(std::sqrt(VarianceAt(spline.At(100, 50), fit.Covariance())), 0.01 * 0.1, 2e-4);
}

class ResponseFile : public Workspace {
 protected:
  std::string MessageOf(const std::string& text) const {
    Write("pcalib.txt", text);
    return RefusalOf([&] { ReadResponse(Path("pcalib.txt")); });
  }
};

TEST_F(ResponseFile, IsReadAsItWasWritten) {
  ResponseCurve::Table light;
  for (size_t k = 0; k < light.size(); ++k) light[k] = PowerLaw(static_cast<double>(k));
  Write("pcalib.txt", PcalibText(ResponseCurve(light)));
  const ResponseCurve read = ReadResponse(Path("pcalib.txt"));
  for (size_t k = 0; k < light.size(); ++k) EXPECT_NEAR(read.Light(k), light[k], 1e-6);
  std::ifstream file(Path("pcalib.txt"));
  const std::vector<double> numbers{std::istream_iterator<double>(file), {}};
  ASSERT_EQ(numbers.size(), 256U);
  EXPECT_EQ(numbers[0], 0);
  EXPECT_EQ(numbers[255], 255);
  const ResponseCurve::Borders borders = read.MakeBorders();
  EXPECT_NEAR(borders[100], PowerLaw(100.5), 1e-4);
}

TEST_F(ResponseFile, IsRefusedWithWhatIsWrong) {
  EXPECT_THAT(MessageOf("1 2 3"), HasSubstr("pcalib.txt: expected 256 numbers, found 3"));
  std::string text;
  for (int k = 0; k < 256; ++k) text += fmt::format("{} ", k == 7 ? 6 : k);
  EXPECT_THAT(MessageOf(text), HasSubstr("value 7 (6) does not exceed"));
  text[0] = 'x';
  EXPECT_THAT(MessageOf(text), HasSubstr("value 0: expected a number, found 'x'"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
