// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/template_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <optional>
#include <random>
#include <string>

#include "tests/detectors/plenoptic/plenoptic_scene.h"

namespace plenocal::internal {
namespace TEST_FILE {

constexpr double kNominal = 3;  // px, the unit of the template
constexpr double kNoise = 1;    // grey values, sigma

/// A white disc on black in the middle micro image, sampled within each pixel: it has the blur of a
/// pixel's area and nothing of the template's formulas.
class DiscImage {
 public:
  explicit DiscImage(double radius) : radius_(radius), array_(PlenopticScene{.types = 1}.Array()) {
    for (size_t i = 0; i < array_.lenses.size(); ++i) {
      if ((array_.lenses[i].centre - Eigen::Vector2d(200, 200)).norm() <
          (array_.lenses[lens_].centre - Eigen::Vector2d(200, 200)).norm()) {
        lens_ = i;
      }
    }
    truth_ = array_.lenses[lens_].centre + Eigen::Vector2d(1.23, -0.68);
  }

  [[nodiscard]] const Eigen::Vector2d& Truth() const { return truth_; }

  /// The fit from a position that is `error` px off. Pixels to the right of `dark` px from the
  /// centre have 0.7 of the light, less than the fit uses. `stated_noise`: sigma that the fit is
  /// told, of a patch's value.
  [[nodiscard]] std::optional<TemplateFit> Fit(unsigned seed,
                                               const Eigen::Vector2d& error,
                                               double dark = 100,
                                               double stated_noise = kNoise,
                                               std::optional<MosaicWeights> mosaic = {}) const {
    constexpr int kSamples = 16;
    std::mt19937 random(seed);
    std::normal_distribution<double> normal(0, kNoise);
    cv::Mat raw(400, 400, CV_32F, cv::Scalar(50)), attenuation(400, 400, CV_32F, cv::Scalar(1));
    const Eigen::Vector2d centre = array_.lenses[lens_].centre;
    for (int y = 180; y < 220; ++y) {
      for (int x = 180; x < 220; ++x) {
        double white = 0;
        for (int k = 0; k < kSamples * kSamples; ++k) {
          const int column = k % kSamples, row = k / kSamples;
          const Eigen::Vector2d at(x - 0.5 + (column + 0.5) / kSamples,
                                   y - 0.5 + (row + 0.5) / kSamples);
          white += (at - truth_).norm() < radius_ ? 1 : 0;
        }
        const double light = x > centre.x() + dark ? 0.7 : 1;
        attenuation.at<float>(y, x) = static_cast<float>(light);
        raw.at<float>(y, x) =
            static_cast<float>(light * (50 + 100 * white / (kSamples * kSamples)) + normal(random));
      }
    }
    const LensPatches patches = CutPatches(raw, attenuation, array_, mosaic, 1);
    ExpectedMarker expected;
    expected.lens = static_cast<int>(lens_);
    expected.position = truth_ + error;
    expected.cell_px = kNominal;
    expected.cells_by_raw = Eigen::Matrix3f::Identity() / static_cast<float>(kNominal);
    expected.cells_by_raw(2, 2) = 1;
    const MarkerTemplate marker{.cells_by_image = {}, .pattern = DiscTemplate(1)};
    const FitPriors priors{{0.5, 0.3}, ShapePrior(marker), 1};
    const SensorNoise noise{static_cast<float>(stated_noise * stated_noise), 0};
    return FitTemplate(marker, expected, patches, noise, priors);
  }

 private:
  double radius_;
  MicroLensArray array_;
  size_t lens_ = 0;
  Eigen::Vector2d truth_;
};

TEST(FitTemplate, FindsPositionAndRadiusOfADisc) {
  int checked = 0;
  for (const double radius : {2.5, 3.0, 3.7}) {
    const DiscImage image(radius);
    const auto fit = image.Fit(1, {0.4, -0.3});
    ASSERT_TRUE(fit) << radius;
    EXPECT_LT((fit->position - image.Truth()).norm(), 0.03) << radius;
    EXPECT_NEAR(fit->shape, radius / kNominal, 0.02) << radius;
    EXPECT_LT(fit->blur, 0.6) << radius;
    ++checked;
  }
  EXPECT_EQ(checked, 3);
}

// Scatter over sigma of the fits to images with different noise.
double ScatterOverSigma(double stated_noise, std::optional<MosaicWeights> mosaic) {
  constexpr int kRuns = 120;
  const DiscImage image(3);
  Eigen::Vector2d sum(0, 0);
  double squares = 0, sigmas = 0;
  for (int run = 0; run < kRuns; ++run) {
    const auto fit =
        image.Fit(100 + static_cast<unsigned>(run), {0.2, 0.1}, 100, stated_noise, mosaic);
    if (!fit) {
      ADD_FAILURE() << run;
      return 0;
    }
    const Eigen::Vector2d error = fit->position - image.Truth();
    sum += error;
    squares += error.squaredNorm() / 2;
    sigmas += fit->sigma;
  }
  const Eigen::Vector2d mean = sum / kRuns;
  // A Gaussian blur is not quite that of a square pixel.
  EXPECT_LT(mean.norm(), 0.015);
  return std::sqrt(squares / kRuns - mean.squaredNorm() / 2) / (sigmas / kRuns);
}

// Of the 240 coordinates the scatter is known to 5 %; sigma is the larger of the noise's and the
// residuals', so it is rather too large.
TEST(FitTemplate, HasTheSigmaOfItsScatter) {
  const double ratio = ScatterOverSigma(kNoise, std::nullopt);
  RecordProperty("scatter_over_sigma", std::to_string(ratio));
  EXPECT_LT(ratio, 1.15);
  EXPECT_GT(ratio, 0.77);
}

// Binomial means of 3 x 3 pixels have 3/8 of their noise, and share it with their neighbours.
TEST(FitTemplate, HasTheSigmaOfItsScatterInAMosaic) {
  const double ratio = ScatterOverSigma(0.375 * kNoise, MosaicWeights{0.25, 0.25, 0.25, 0.25});
  RecordProperty("scatter_over_sigma", std::to_string(ratio));
  EXPECT_LT(ratio, 1.15);
  EXPECT_GT(ratio, 0.77);
}

TEST(FitTemplate, HasTheSigmaOfItsResidualsWhereTheyAreLarger) {
  const DiscImage image(3);
  double ratios[2] = {0, 0}, of_blur = 0;
  constexpr int kRuns = 30;
  for (unsigned run = 0; run < kRuns; ++run) {
    const auto right = image.Fit(run, {0.2, 0.1}),
               less = image.Fit(run, {0.2, 0.1}, 100, kNoise / 4),
               more = image.Fit(run, {0.2, 0.1}, 100, 4 * kNoise);
    ASSERT_TRUE(right && less && more);
    ratios[0] += less->sigma / right->sigma / kRuns;
    ratios[1] += more->sigma / right->sigma / kRuns;
    of_blur += less->blur_sigma / right->blur_sigma / kRuns;
  }
  EXPECT_NEAR(ratios[0], 1, 0.15);
  EXPECT_NEAR(ratios[1], 4, 0.6);
  EXPECT_NEAR(of_blur, 1, 0.3);  // with the prior
}

TEST(FitTemplate, StartsFromTheSamePlaceOrNowhere) {
  const DiscImage image(3);
  const auto near = image.Fit(1, {0.05, 0}), far = image.Fit(1, {-0.6, 0.5});
  ASSERT_TRUE(near && far);
  EXPECT_LT((near->position - far->position).norm(), 2e-3);
  EXPECT_TRUE(image.Fit(1, {1.2, 0}));
  // Farther than half the disc's radius it might be another one.
  EXPECT_FALSE(image.Fit(1, {1.6, -1}));
}

TEST(FitTemplate, RefusesADiscWhoseEdgeIsDark) {
  const DiscImage image(3);
  EXPECT_TRUE(image.Fit(1, {0.1, 0.1}, 7));
  EXPECT_FALSE(image.Fit(1, {0.1, 0.1}, 3));
}

TEST(FitTemplate, IsInsensitiveToVignettingInAnEvenlyLitMicroImage) {
  const auto fit = DiscImage(3).Fit(1, {0.1, 0.1});
  ASSERT_TRUE(fit);
  EXPECT_EQ(fit->vignetting_sensitivity.norm(), 0);
  // A larger template around its centre does not move it.
  EXPECT_LT(fit->depth_sensitivity.norm(), 0.06);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
