// SPDX-License-Identifier: Apache-2.0
#include "calib/camera/lens_type_optics.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <random>
#include <utility>

namespace plenocal {
namespace TEST_FILE {

const MicroLensGeometry kGeometry{
    .f_L = 0.0145, .b_L0 = 0.0140, .B = 255e-6, .b_P = 0.0140, .pixel_size = 7.4e-6, .sigma_B = 0};
constexpr double kAperture = 105e-6;                     // m
constexpr std::array kFocus{1 / 3.1, 1 / 2.4, 1 / 4.5};  // 1 / v in focus, the paper's v

/// The edge's profile: a disc of this diameter, then a Gaussian of this standard deviation.
double Edge(double x, double diameter, double sigma) {
  constexpr int kSteps = 30;
  double sum = 0, weights = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double u = (i + 0.5) / kSteps * 2 - 1, weight = std::sqrt(1 - u * u);
    sum += weight * std::erfc((u * diameter / 2 - x) / (sigma * std::numbers::sqrt2)) / 2;
    weights += weight;
  }
  return sum / weights;
}

/// The Gaussian that fits that edge best by least squares, by bisection of the derivative; kept,
/// for the tests share their discs.
double FittedBlur(double diameter, double sigma) {
  static std::map<std::pair<double, double>, double> kept;
  const auto [at, is_new] = kept.emplace(std::pair(diameter, sigma), 0);
  if (!is_new) return at->second;
  const auto slope = [&](double blur) {
    double sum = 0;
    for (double x = -6; x <= 6; x += 0.1) {
      const double misfit =
          std::erfc(-x / (blur * std::numbers::sqrt2)) / 2 - Edge(x, diameter, sigma);
      sum -= misfit * x * std::exp(-x * x / (2 * blur * blur));
    }
    return sum;
  };
  double low = sigma, high = sigma + diameter;
  for (int i = 0; i < 20; ++i) (slope((low + high) / 2) < 0 ? low : high) = (low + high) / 2;
  return at->second = low;
}

/// Blur of every lens type by depth, with errors of `sigma` px; `nearer`: the part by which B is
/// larger in one half of the array, and smaller in the other.
std::vector<BlurMeasurement> Blurs(double nearest,
                                   double farthest,
                                   double sigma,
                                   double nearer = 0) {
  constexpr int kDepths = 30;
  constexpr double kSensor = 0.4;  // px
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, sigma);
  const double g = kGeometry.b_P / (kGeometry.b_P + kGeometry.B);
  std::vector<BlurMeasurement> blurs;
  for (int type = 0; type < 3; ++type) {
    for (int i = 0; i < kDepths; ++i) {
      const double w = nearest + (farthest - nearest) * i / (kDepths - 1.0);  // 1 / v, the paper's
      const double side = i % 2 == 0 ? 1 : -1;
      const double focus = 1 - (1 - kFocus[type]) * (1 + side * nearer);
      const double disc = kAperture / kGeometry.pixel_size * std::abs(w - focus);
      blurs.push_back({.lens_type = type,
                       .inverse_depth = 1 - g * (1 - w),
                       .blur = FittedBlur(disc, kSensor) + noise(random),
                       .sigma = sigma,
                       .place = {500 + 300 * side, 500}});
    }
  }
  return blurs;
}

TEST(LensTypeOptics, AreFoundFromBlurOnEitherSideOfTheFocus) {
  const auto types = EstimateLensTypes(Blurs(0.26, 0.40, 0.005), kGeometry);
  ASSERT_EQ(types.size(), 3u);
  for (size_t i = 0; i < types.size(); ++i) {
    const double truth = kGeometry.B / (1 - kFocus[i]);
    EXPECT_NEAR(types[i].focal_length, truth, 0.005 * truth) << i;
    EXPECT_LT(types[i].focal_length_sigma, 0.01 * truth);
    EXPECT_NEAR(types[i].aperture, kAperture, 0.03 * kAperture);
  }
}

TEST(LensTypeOptics, FollowTheTiltOfTheArray) {
  MicroLensGeometry tilted = kGeometry;
  tilted.principal_point = {500, 500};
  const double c_ML = 300 * kGeometry.pixel_size * kGeometry.b_P / (kGeometry.b_P + kGeometry.B);
  tilted.tilt = {0.008, 0.001};  // along y there is no marker
  const std::vector<BlurMeasurement> blurs =
      Blurs(0.26, 0.40, 0.005, tilted.tilt.x() * c_ML / kGeometry.B);
  const auto types = EstimateLensTypes(blurs, tilted);
  ASSERT_EQ(types.size(), 3u);
  for (size_t i = 0; i < types.size(); ++i) {
    const double truth = kGeometry.B / (1 - kFocus[i]);
    EXPECT_NEAR(types[i].focal_length, truth, 0.006 * truth) << i;
    EXPECT_NEAR(types[i].aperture, kAperture, 0.05 * kAperture);
  }
  // Without the tilt the halves of the array contradict each other.
  EXPECT_TRUE(EstimateLensTypes(blurs, kGeometry).empty());
}

TEST(LensTypeOptics, DepthOfFieldIsWhereTheDiscIsSmallerThanAPixel) {
  for (const LensTypeOptics& type : EstimateLensTypes(Blurs(0.26, 0.40, 0.005), kGeometry)) {
    EXPECT_NEAR(BlurDisc(type, kGeometry, type.near), 1, 1e-6);
    EXPECT_NEAR(BlurDisc(type, kGeometry, type.in_focus), 0, 1e-6);
    ASSERT_TRUE(std::isfinite(type.far));
    EXPECT_NEAR(BlurDisc(type, kGeometry, type.far), 1, 1e-6);
    EXPECT_LT(type.near, type.in_focus);
    EXPECT_LT(type.in_focus, type.far);
  }
}

TEST(LensTypeOptics, AreNotReportedWhereNoMarkerWasInFocus) {
  std::vector<BlurMeasurement> one_type = Blurs(0.36, 0.40, 0.005);
  std::erase_if(one_type, [](const BlurMeasurement& m) { return m.lens_type != 0; });
  EXPECT_TRUE(EstimateLensTypes(one_type, kGeometry).empty());
}

TEST(LensTypeOptics, AreNotReportedWhereBlurDoesNotChange) {
  EXPECT_TRUE(EstimateLensTypes({}, kGeometry).empty());
  std::vector<BlurMeasurement> same = Blurs(0.30, 0.31, 0.1);
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 0.1);
  for (BlurMeasurement& m : same) m.blur = 0.6 + noise(random);
  EXPECT_TRUE(EstimateLensTypes(same, kGeometry).empty());
}

}  // namespace TEST_FILE
}  // namespace plenocal
