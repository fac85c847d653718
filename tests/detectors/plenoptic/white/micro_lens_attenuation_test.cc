// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/micro_lens_attenuation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "detectors/images/attenuation.h"
#include "tests/detectors/plenoptic/white/white_field.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr double kLevel = 3000;  // of WhiteField, electrons

/// The brightness of the field without noise over its highest, from the renderer's parameters: the
/// fall-off of the main lens at the micro lens that is nearest to the middle is 1.
double TrueAttenuation(const cv::Mat& noiseless, double colour, int x, int y) {
  return noiseless.at<float>(y, x) / (kLevel * colour);
}

RenderedField WithoutNoise(WhiteField field) {
  field.images = 100'000'000;
  return Render(field);
}

TEST(MicroLensAttenuation, IsOneAtTheHighestOfTheEnvelope) {
  const WhiteField field{.size = {400, 300}, .types = 1, .gain_scatter = 0};
  const RenderedField rendered = Render(field), truth = WithoutNoise(field);
  const MicroLensGrid grid = FindMicroLensGrid(rendered.white, 2);
  const cv::Mat attenuation = MicroLensAttenuation(rendered.white, grid, std::nullopt);
  int checked = 0;
  for (const TrueLens& lens : truth.lenses) {
    const int x = static_cast<int>(std::lround(lens.centre.x()));
    const int y = static_cast<int>(std::lround(lens.centre.y()));
    if (x < 0 || y < 0 || x >= 400 || y >= 300) continue;
    // Shot noise of a pixel is 0.6 %; the renderer adds 2 % of stray light everywhere.
    EXPECT_NEAR(attenuation.at<float>(y, x), TrueAttenuation(truth.white, 1, x, y), 0.045);
    ++checked;
  }
  EXPECT_GT(checked, 250);
  double highest = 0;
  cv::minMaxLoc(attenuation, nullptr, &highest);
  EXPECT_LE(highest, 1);
}

TEST(MicroLensAttenuation, HasTheFallOffOfTheMainLens) {
  const WhiteField field{.size = {500, 400}, .types = 1, .gain_scatter = 0};
  const cv::Mat white = Render(field).white;
  const cv::Mat attenuation =
      MicroLensAttenuation(white, FindMicroLensGrid(white, 2), std::nullopt);
  // Mean over whole cells, in the middle and in a corner; the renderer's cos^4-like law.
  const auto mean = [&](int x, int y) { return cv::mean(attenuation(cv::Rect(x, y, 60, 52)))[0]; };
  const Eigen::Vector2d middle(249.5, 199.5), corner(30, 26);
  const double ratio = (corner - middle).squaredNorm() / middle.squaredNorm();
  EXPECT_NEAR(mean(0, 0) / mean(220, 174), 1 / std::pow(1 + 0.2 * ratio, 2), 0.02);
}

TEST(MicroLensAttenuation, IsNotRaisedByABrightMicroLensOrNoise) {
  WhiteField field{.size = {400, 300}, .types = 1, .images = 1, .gain_scatter = 0};
  const cv::Mat white = Render(field).white;
  const MicroLensGrid grid = FindMicroLensGrid(white, 2);
  const cv::Mat usual = MicroLensAttenuation(white, grid, std::nullopt);
  cv::Mat spoiled = white.clone();
  spoiled.at<float>(150, 200) *= 3;  // a hot pixel
  const cv::Mat attenuation =
      MicroLensAttenuation(spoiled, FindMicroLensGrid(spoiled, 2), std::nullopt);
  EXPECT_NEAR(cv::mean(attenuation)[0] / cv::mean(usual)[0], 1, 0.01);
}

TEST(MicroLensAttenuation, OfAMosaicIsThatOfAGreyCamera) {
  WhiteField field{.size = {500, 400}, .types = 1, .gain_scatter = 0};
  const cv::Mat grey = Render(field).white;
  field.bayer = true;
  const cv::Mat mosaic = Render(field).white;
  const cv::Mat expected = MicroLensAttenuation(grey, FindMicroLensGrid(grey, 2), std::nullopt);
  const cv::Mat attenuation = MicroLensAttenuation(
      mosaic, FindMicroLensGrid(LevelBayerPlanes(mosaic), 2), BayerOrder::kRggb);
  double difference = 0;
  int count = 0;
  for (int y = 0; y < expected.rows; ++y) {
    for (int x = 0; x < expected.cols; ++x) {
      if (expected.at<float>(y, x) < 0.5) continue;
      difference += std::abs(attenuation.at<float>(y, x) / expected.at<float>(y, x) - 1);
      ++count;
    }
  }
  ASSERT_GT(count, 50000);
  EXPECT_LT(difference / count, 0.02);
}

TEST(LevelBayerPlanes, TakesTheColourOfTheLightAway) {
  const cv::Mat mosaic = Render({.size = {400, 300}, .bayer = true}).white;
  EXPECT_GT(PlaneDifference(mosaic), 0.3);
  EXPECT_EQ(PlaneDifference(LevelBayerPlanes(mosaic)), 0);
  EXPECT_EQ(PlaneDifference(Render({.size = {400, 300}}).white), 0);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
