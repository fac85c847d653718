// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/lens_patches.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>

#include "tests/detectors/plenoptic/plenoptic_scene.h"

namespace plenocal::internal {
namespace TEST_FILE {

/// A scene that is linear over the sensor; linear interpolation keeps it.
double Scene(double x, double y) { return 100 + 0.7 * x - 0.3 * y; }

/// An attenuation that changes over the sensor too: raw = scene * attenuation.
double Even(double x, double y) { return 0.5 + 0.0005 * x + 0.0003 * y; }

cv::Mat Image(const cv::Size& size, double (*value)(double, double)) {
  cv::Mat image(size, CV_32F);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) image.at<float>(y, x) = static_cast<float>(value(x, y));
  }
  return image;
}

class Patches : public ::testing::Test {
 protected:
  Patches() {
    array_ = PlenopticScene{}.Array();
    const cv::Size size(array_.image_size[0], array_.image_size[1]);
    attenuation_ = Image(size, Even);
    raw_ = Image(size, Scene).mul(attenuation_);
  }
  /// Calls `use` with the raw coordinates and the value of each known pixel; returns their number.
  template <typename Use>
  static int ForEachKnown(const LensPatches& patches, size_t lens, const Use& use) {
    int known = 0;
    for (int y = 0; y < patches.size; ++y) {
      for (int x = 0; x < patches.size; ++x) {
        const float value = patches.Value(lens)[y * patches.size + x];
        if (std::isnan(value)) continue;
        use(patches.origin[lens].x() + x, patches.origin[lens].y() + y, value);
        ++known;
      }
    }
    return known;
  }

  MicroLensArray array_;
  cv::Mat attenuation_, raw_;
};

TEST_F(Patches, HoldTheSceneWithoutAttenuation) {
  const LensPatches patches = CutPatches(raw_, attenuation_, array_, std::nullopt, 2);
  const double radius = array_.Pitch() / 2 - 0.5;
  EXPECT_NEAR(patches.radius_px, radius, 1e-5);
  int whole = 0;
  for (size_t l = 0; l < array_.lenses.size(); ++l) {
    const Eigen::Vector2d c = array_.lenses[l].centre;
    EXPECT_LT((patches.origin[l].cast<double>() + patches.centre[l].cast<double>() - c).norm(),
              1e-4);
    const int known = ForEachKnown(patches, l, [&](int x, int y, float value) {
      EXPECT_LT((Eigen::Vector2d(x, y) - c).norm(), radius + 1e-5);
      EXPECT_NEAR(value, Scene(x, y), 1e-3);
    });
    const double to_edge = std::min({c.x(), c.y(), 399 - c.x(), 399 - c.y()});
    if (to_edge < radius) continue;
    ++whole;
    EXPECT_NEAR(known, 3.14159 * radius * radius, 12);  // pixels of a disc
  }
  EXPECT_GT(whole, 300);
}

TEST_F(Patches, EndWhereHalfTheLightIsLost) {
  const MicroLens& lens = array_.lenses[array_.lenses.size() / 2];
  for (int y = 0; y < attenuation_.rows; ++y) {
    for (int x = 0; x < attenuation_.cols; ++x) {
      if (x > lens.centre.x() + 3) attenuation_.at<float>(y, x) *= 0.4f;
    }
  }
  const LensPatches patches = CutPatches(raw_, attenuation_, array_, std::nullopt, 1);
  const int known = ForEachKnown(patches, array_.lenses.size() / 2, [&](int x, int, float) {
    EXPECT_LE(x, lens.centre.x() + 3);
  });
  EXPECT_GT(known, 100);
}

TEST_F(Patches, OfUnusableMicroLensesAreEmpty) {
  array_.lenses[50].usable = false;
  const LensPatches patches = CutPatches(raw_, attenuation_, array_, std::nullopt, 2);
  EXPECT_EQ(ForEachKnown(patches, 50, [](int, int, float) {}), 0);
  EXPECT_GT(ForEachKnown(patches, 51, [](int, int, float) {}), 0);
  EXPECT_EQ(patches.HighestAttenuation(50), 0);
  EXPECT_NEAR(patches.HighestAttenuation(51),
              attenuation_.at<float>(array_.lenses[51].centre.y(), array_.lenses[51].centre.x()),
              0.01);
}

TEST_F(Patches, OfOneColourOfAMosaicAreInterpolatedLinearly) {
  // Only the red pixels of an RGGB mosaic have the scene, the others something else.
  for (int y = 0; y < raw_.rows; ++y) {
    for (int x = 0; x < raw_.cols; ++x) {
      if (x % 2 != 0 || y % 2 != 0) raw_.at<float>(y, x) = 7;
    }
  }
  const LensPatches patches = CutPatches(raw_, attenuation_, array_, MosaicWeights{1, 0, 0, 0}, 2);
  EXPECT_EQ(patches.filter_radius, 1);
  int known = 0;
  for (size_t l = 0; l < array_.lenses.size(); ++l) {
    known += ForEachKnown(
        patches, l, [&](int x, int y, float value) { EXPECT_NEAR(value, Scene(x, y), 1e-2); });
  }
  EXPECT_GT(known, 50000);
}

// Colours that are even each give one value wherever a micro image begins.
TEST_F(Patches, OfAMosaicHaveTheWeightedMeanOfItsFourPixels) {
  const std::array<float, 4> value{10, 200, 70, 90};
  const MosaicWeights weights{0.1F, 0.2F, 0.3F, 0.4F};
  for (int y = 0; y < raw_.rows; ++y) {
    for (int x = 0; x < raw_.cols; ++x) {
      raw_.at<float>(y, x) = value[static_cast<size_t>(2 * (y % 2) + x % 2)];
    }
  }
  const cv::Mat even(raw_.size(), CV_32F, cv::Scalar(1));
  const LensPatches patches = CutPatches(raw_, even, array_, weights, 2);
  int known = 0;
  for (size_t l = 0; l < array_.lenses.size(); ++l) {
    known += ForEachKnown(patches, l, [&](int, int, float mean) {
      EXPECT_NEAR(mean, 0.1 * 10 + 0.2 * 200 + 0.3 * 70 + 0.4 * 90, 1e-3);
    });
  }
  EXPECT_GT(known, 1000);
}

TEST_F(Patches, WeighTheirPixelsToOne) {
  LensPatches patches;
  for (patches.filter_radius = 0; patches.filter_radius <= 1; ++patches.filter_radius) {
    double sum = 0;
    for (int y = -patches.filter_radius; y <= patches.filter_radius; ++y) {
      for (int x = -patches.filter_radius; x <= patches.filter_radius; ++x) {
        sum += patches.FilterWeight(x, y);
      }
    }
    EXPECT_NEAR(sum, 1, 1e-12);
  }
}

TEST_F(Patches, HaveTheSlopeOfTheLogarithmicAttenuation) {
  const LensPatches patches = CutPatches(raw_, attenuation_, array_, std::nullopt, 2);
  const size_t lens = array_.lenses.size() / 2;
  const int x = patches.size / 2, y = patches.size / 2;
  const Eigen::Vector2i raw = patches.origin[lens] + Eigen::Vector2i(x, y);
  const double v = Even(raw.x(), raw.y());
  const Eigen::Vector2f slope = patches.LogAttenuationGradient(lens, x, y);
  EXPECT_NEAR(slope.x(), 0.0005 / v, 1e-6);
  EXPECT_NEAR(slope.y(), 0.0003 / v, 1e-6);
}

/// Micro images of many brightnesses with the sensor's noise; some have texture.
LensPatches NoisyPatches(double read, double shot, double textured, double attenuation = 1) {
  const MicroLensArray array = PlenopticScene{.width = 900, .height = 900}.Array();
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0, 1);
  cv::Mat raw(900, 900, CV_32F, cv::Scalar(0)), even(900, 900, CV_32F, cv::Scalar(attenuation));
  for (const MicroLens& lens : array.lenses) {
    const double level = 20 + 200 * uniform(random);
    const double contrast = uniform(random) < textured ? 30 : 0;
    for (int y = -9; y <= 9; ++y) {
      for (int x = -9; x <= 9; ++x) {
        const int column = static_cast<int>(std::lround(lens.centre.x())) + x;
        const int row = static_cast<int>(std::lround(lens.centre.y())) + y;
        if (column < 0 || row < 0 || column >= 900 || row >= 900) continue;
        // Micro images do not overlap.
        if ((Eigen::Vector2d(column, row) - lens.centre).norm() > 9) continue;
        const double value = attenuation * (level + contrast * std::sin(1.3 * column + 0.9 * row));
        raw.at<float>(row, column) =
            static_cast<float>(value + std::sqrt(read + shot * value) * normal(random));
      }
    }
  }
  return CutPatches(raw, even, array, std::nullopt, 2);
}

TEST(EstimateNoise, FindsReadAndShotNoise) {
  for (const double textured : {0.0, 0.3}) {
    const SensorNoise noise = EstimateNoise(NoisyPatches(2.0, 0.05, textured));
    // At the middle brightness both together; the split between them is less certain.
    const double middle = noise.read + noise.shot * 120;
    EXPECT_NEAR(middle, 2.0 + 0.05 * 120, 0.15 * (2.0 + 0.05 * 120)) << textured;
    EXPECT_NEAR(noise.shot, 0.05, 0.02) << textured;
  }
}

TEST(EstimateNoise, IsThatOfRawValuesUnderAnyAttenuation) {
  const SensorNoise noise = EstimateNoise(NoisyPatches(2.0, 0.05, 0, 0.5));
  const double middle = noise.read + noise.shot * 60;
  EXPECT_NEAR(middle, 2.0 + 0.05 * 60, 0.15 * (2.0 + 0.05 * 60));
  EXPECT_NEAR(noise.shot, 0.05, 0.02);
}

TEST(EstimateNoise, IsAtLeastThatOfRounding) {
  const SensorNoise noise = EstimateNoise(NoisyPatches(0, 0, 0));
  EXPECT_NEAR(noise.read, 1 / 12.0, 1e-6);
  EXPECT_NEAR(noise.shot, 0, 1e-6);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
