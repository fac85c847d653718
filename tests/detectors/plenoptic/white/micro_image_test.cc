// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/micro_image.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <random>
#include <vector>

namespace plenocal::internal {
namespace TEST_FILE {

constexpr double kPitch = 20, kGain = 800;
constexpr double kRadius = 0.7 * kPitch;  // of the profile

/// A disc with a soft edge, by the error function: what a micro image is, and no spline.
double Disc(double r) { return 0.5 * std::erfc((r - 0.45 * kPitch) / 1.1); }

/// One micro image under a gradient of brightness, relative per px.
cv::Mat Render(const Eigen::Vector2d& centre, const Eigen::Vector2d& gradient, double noise) {
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  cv::Mat white(41, 41, CV_32F);
  for (int y = 0; y < white.rows; ++y) {
    for (int x = 0; x < white.cols; ++x) {
      const Eigen::Vector2d d = Eigen::Vector2d(x, y) - centre;
      white.at<float>(y, x) = static_cast<float>(kGain * Disc(d.norm()) * (1 + gradient.dot(d)) +
                                                 noise * normal(random));
    }
  }
  return white;
}

RadialProfile TrueProfile() {
  ProfileFit fit(kRadius, 1);
  for (double r = 0; r < kRadius; r += 0.05)
    fit.Add(Disc(r), r, std::vector{Contribution{0, r, 1}});
  RadialProfile profile = fit.Solve()[0];
  profile.Normalise();
  return profile;
}

TEST(ProfileFit, FollowsASoftDisc) {
  const RadialProfile profile = TrueProfile();
  int checked = 0;
  for (double r = 0; r < kRadius - 1; r += 0.3) {
    EXPECT_NEAR(profile.At(r).value, Disc(r), 0.003) << r;
    EXPECT_NEAR(profile.At(r).slope, (Disc(r + 1e-4) - Disc(r - 1e-4)) / 2e-4, 0.02) << r;
    // Within one cubic.
    const double s = r + 0.1;
    const double own = (profile.At(s + 1e-5).value - profile.At(s - 1e-5).value) / 2e-5;
    EXPECT_NEAR(profile.At(s).slope, own, 1e-8) << s;
    ++checked;
  }
  EXPECT_GT(checked, 40);
  EXPECT_EQ(profile.At(kRadius + 1).value, 0);
}

TEST(ProfileFit, SeparatesOverlappingMicroImages) {
  // Pixels between two types at a distance of one pitch; each sees the light of both.
  const auto other = [](double r) { return 0.8 * std::erfc((r - 0.5 * kPitch) / 1.5) / 2; };
  ProfileFit fit(kRadius, 2);
  for (double t = 0; t < kPitch; t += 0.11) {
    for (double side = 0; side < 4; side += 0.37) {
      const double a = std::hypot(t, side), b = std::hypot(kPitch - t, side);
      fit.Add(Disc(a) + 2 * other(b), 1, std::vector{Contribution{0, a, 1}, Contribution{1, b, 2}});
    }
  }
  const auto profiles = fit.Solve();
  ASSERT_EQ(profiles.size(), 2u);
  for (const double r : {1.0, 4.0, 8.0, 9.0, 10.0, 11.0}) {
    EXPECT_NEAR(profiles[0].At(r).value, Disc(r), 0.02) << r;
    EXPECT_NEAR(profiles[1].At(r).value, other(r), 0.02) << r;
  }
}

TEST(FitMicroImage, FindsTheCentreUnderAGradientThatMovesTheCentroid) {
  const RadialProfile profile = TrueProfile();
  const Eigen::Vector2d truth(20.3, 19.8), gradient(0.02, -0.01);
  const cv::Mat white = Render(truth, gradient, 2);
  Eigen::Vector2d centroid(0, 0);
  double sum = 0;
  for (int y = 0; y < white.rows; ++y) {
    for (int x = 0; x < white.cols; ++x) {
      centroid += white.at<float>(y, x) * Eigen::Vector2d(x, y);
      sum += white.at<float>(y, x);
    }
  }
  EXPECT_GT((centroid / sum - truth).norm(), 0.2);

  MicroImage start{.centre = {20, 20}, .gain = 700};
  cv::Mat light = cv::Mat::zeros(white.size(), CV_32F);
  for (int round = 0; round < 3; ++round) {
    light.setTo(0);
    AddLight(profile, start, &light);
    start = FitMicroImage({white, light}, profile, kPitch / 2, start);
  }
  EXPECT_LT((start.centre - truth).norm(), 0.02);
  EXPECT_NEAR(start.gain, kGain, 0.01 * kGain);
  EXPECT_LT((start.gradient - kGain * gradient).norm(), 0.1 * kGain * gradient.norm());
  EXPECT_NEAR(start.scale, 1, 0.005);
  // Noise of 2 grey values, and what the spline leaves.
  EXPECT_LT(start.residual, 4);
  EXPECT_LT((start.centre - truth).norm(), 5 * 2 * start.centre_sigma + 0.005);
}

TEST(FitMicroImage, HasNoSigmaWhereThereIsNoMicroImage) {
  const RadialProfile profile = TrueProfile();
  cv::Mat noise(41, 41, CV_32F);
  cv::theRNG().state = 5;
  cv::randn(noise, 0, 2);
  const MicroImage start{.centre = {20, 20}, .gain = 5};
  cv::Mat light = cv::Mat::zeros(noise.size(), CV_32F);
  AddLight(profile, start, &light);
  const MicroImage fit = FitMicroImage({noise, light}, profile, kPitch / 2, start);
  // Either it was refused or its brightness is noise.
  EXPECT_TRUE(fit.centre_sigma == 0 || std::abs(fit.gain) < 2) << fit.gain;
}

// The image is the model less twice its derivative by the size: a first step of -2.
TEST(FitMicroImage, IsNoneOfANegativeSize) {
  const RadialProfile profile = TrueProfile();
  const MicroImage start{.centre = {20, 20}, .gain = kGain};
  cv::Mat light = cv::Mat::zeros(41, 41, CV_32F), white(41, 41, CV_32F);
  AddLight(profile, start, &light);
  for (int y = 0; y < white.rows; ++y) {
    for (int x = 0; x < white.cols; ++x) {
      const double r = std::hypot(x - 20, y - 20), by_size = -kGain * profile.At(r).slope * r;
      white.at<float>(y, x) = light.at<float>(y, x) + static_cast<float>(-2 * by_size);
    }
  }
  const MicroImage fit = FitMicroImage({white, light}, profile, kPitch / 2, start);
  EXPECT_EQ(fit.centre_sigma, 0);
  EXPECT_EQ(fit.scale, 1);
}

TEST(RingResiduals, AreZeroForACompleteModel) {
  const RadialProfile profile = TrueProfile();
  const MicroImage image{.centre = {20.2, 20.4}, .gain = kGain};
  const cv::Mat white = Render(image.centre, {0, 0}, 0);
  cv::Mat light = cv::Mat::zeros(white.size(), CV_32F);
  EXPECT_GT(RingResiduals({white, light}, image, kPitch / 2, 8)[0], 0.9);
  AddLight(profile, image, &light);
  const Eigen::VectorXd rings = RingResiduals({white, light}, image, kPitch / 2, 8);
  ASSERT_EQ(rings.size(), 8);
  EXPECT_LT(rings.cwiseAbs().maxCoeff(), 0.003);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
