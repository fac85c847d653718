// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/image_synthesis.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <opencv2/core.hpp>

#include "detectors/plenoptic/depth/micro_lens_index.h"
#include "tests/detectors/plenoptic/depth/wave_scene.h"

namespace plenocal::internal {
namespace TEST_FILE {

constexpr double kScale = 2;  // raw px per pixel

/// The image of a plane of waves whose depth is known.
struct Synthesis {
  WaveScene scene;
  LensPatches patches;
  VirtualDepth depth;
  SensorNoise noise;
  DepthSurvey survey;

  explicit Synthesis(const WaveScene& waves) : scene(waves), patches(waves.Patches()) {
    const cv::Size size(scene.array.image_size[0] / 2, scene.array.image_size[1] / 2);
    depth.scale = kScale;
    depth.inverse = cv::Mat(size, CV_32F, cv::Scalar(1 / scene.v));
    depth.sigma = cv::Mat(size, CV_32F, cv::Scalar(0.001));
    depth.known = cv::Mat(size, CV_8U, cv::Scalar(255));
    noise.read = static_cast<float>(scene.noise * scene.noise);
    const auto z = static_cast<float>(1 / scene.v);
    survey.range = {z - 0.02F, z + 0.02F};
    survey.defocus.resize(3);
  }
  [[nodiscard]] cv::Mat Image(int threads = 2) const {
    return SynthesiseFocusedImage(
        depth, patches, MicroLensIndex(scene.array), noise, survey, threads);
  }
  /// What a sharp micro lens shows of a pixel in its middle.
  [[nodiscard]] double Truth(int x, int y) const {
    WaveScene sharp = scene;
    sharp.blur = {};
    MicroLens at;
    at.centre = kScale * Eigen::Vector2d(x, y);
    return sharp.Value(at.centre, at);
  }
  /// RMS error away from the image's edges.
  [[nodiscard]] double Error(const cv::Mat& image) const {
    double squares = 0;
    int count = 0;
    for (int y = 20; y < image.rows - 20; ++y) {
      for (int x = 20; x < image.cols - 20; ++x) {
        const double error = image.at<float>(y, x) - Truth(x, y);
        squares += error * error;
        ++count;
      }
    }
    return std::sqrt(squares / count);
  }
};

WaveScene Scene(double noise, double blur) {
  WaveScene scene;
  scene.noise = noise;
  scene.blur = {0, blur, blur};
  return scene;
}

TEST(SynthesiseFocusedImage, IsTheMeanOfTheMicroImagesThatSeeAPoint) {
  const Synthesis exact(Scene(0.1, 0));
  // Bilinear interpolation between pixels of a micro image takes a little of the shortest waves.
  const double interpolation = exact.Error(exact.Image());
  EXPECT_LT(interpolation, 1.6);
  // Of 12 micro images and more in view, weighted by 1 - r^2, white noise leaves a third or less.
  const Synthesis noisy(Scene(4, 0));
  const double error = noisy.Error(noisy.Image());
  EXPECT_LT(std::sqrt(error * error - interpolation * interpolation), 4 / 3.0);
  EXPECT_GT(error, interpolation);
}

TEST(SynthesiseFocusedImage, IsThatOfTheSharpType) {
  constexpr double kBlur = 1.2;  // px of a micro image
  Synthesis blurred(Scene(0.5, kBlur));
  const double unknown = blurred.Error(blurred.Image());
  for (const size_t type : {1U, 2U}) blurred.survey.defocus[type].offset = kBlur * kBlur / 2;
  const double known = blurred.Error(blurred.Image());
  EXPECT_LT(known, 0.5 * unknown);
  // Only differences between types count, and their slope by the inverse depth.
  Synthesis sloped(Scene(0.5, kBlur));
  for (size_t type = 0; type < 3; ++type) {
    sloped.survey.defocus[type].offset = type == 0 ? 1 : 0;
    sloped.survey.defocus[type].slope =
        static_cast<float>(sloped.scene.v * (type == 0 ? 0 : 1 + kBlur * kBlur / 2));
  }
  EXPECT_NEAR(sloped.Error(sloped.Image()), known, 0.05 * known);
}

TEST(SynthesiseFocusedImage, LeavesOutWhatDiffersFromTheOthers) {
  Synthesis one_off(Scene(1, 0));
  const cv::Mat before = one_off.Image();
  constexpr size_t kLens = 200;
  for (size_t i = 0; i < one_off.patches.Area(); ++i) {
    one_off.patches.value[kLens * one_off.patches.Area() + i] += 100;
  }
  const cv::Mat after = one_off.Image();
  double most = 0;
  cv::minMaxLoc(cv::abs(after - before), nullptr, &most);
  // About ten micro images see a point. In the middle of this one the mean of all, weighted by
  // 1 - r^2, would move by a fifth of the 100.
  EXPECT_GT(most, 5);
  EXPECT_LT(most, 16);
}

TEST(SynthesiseFocusedImage, IsFilledWhereNothingIsKnown) {
  Synthesis hole(Scene(0.1, 0));
  const cv::Mat whole = hole.Image();
  const cv::Rect part(60, 70, 7, 5);
  hole.depth.inverse(part) = std::numeric_limits<float>::quiet_NaN();
  cv::Mat image = hole.Image();
  EXPECT_TRUE(cv::checkRange(image));
  EXPECT_GT(cv::norm(image(part), whole(part), cv::NORM_INF), 0);
  // From what is around it: within the range of the waves.
  EXPECT_TRUE(cv::checkRange(image(part), true, nullptr, 20, 280));
  whole(part).copyTo(image(part));
  EXPECT_LT(cv::norm(image, whole, cv::NORM_INF), 0.01) << "the rest is the same";
}

TEST(SynthesiseFocusedImage, IsTheSameForAnyNumberOfThreads) {
  const Synthesis scene(Scene(1, 0));
  EXPECT_EQ(cv::norm(scene.Image(1), scene.Image(3), cv::NORM_INF), 0);
}

TEST(ScaleTo8Bits, SaturatesOneInAThousand) {
  cv::Mat image(100, 100, CV_32F);
  for (int i = 0; i < 10000; ++i)
    image.at<float>(i / 100, i % 100) = static_cast<float>((i * 7) % 10000);
  // 9989 is the largest but ten.
  EXPECT_NEAR(ScaleTo8Bits(image), 255 / 9989.0, 1e-9);
  EXPECT_EQ(ScaleTo8Bits(cv::Mat::zeros(10, 10, CV_32F)), 1);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
