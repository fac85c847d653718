// SPDX-License-Identifier: Apache-2.0
//
// The kernels against their definitions, pixel by pixel in double precision.
#include "detectors/plenoptic/depth/depth_kernels.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/base/robust.h"
#include "tests/calib/random.h"

namespace plenocal::internal {
namespace TEST_FILE {

using plenocal::testing::Random;

constexpr int kSize = 24;
const float kUnknown = std::numeric_limits<float>::quiet_NaN();

// Grey values with a share of unknown ones.
std::vector<float> Patch(unsigned seed, double unknown = 0) {
  Random random(seed);
  std::vector<float> patch(kSize * kSize + 16);
  for (float& value : patch) {
    value = static_cast<float>(random.Uniform(10, 200));
    if (random.Uniform(0, 1) < unknown) value = kUnknown;
  }
  return patch;
}

void ExpectSame(const std::vector<float>& found, const std::vector<float>& expected) {
  ASSERT_EQ(found.size(), expected.size());
  for (size_t i = 0; i < found.size(); ++i) {
    if (std::isnan(expected[i]) || std::isinf(expected[i])) {
      EXPECT_EQ(std::isnan(found[i]), std::isnan(expected[i])) << i;
      EXPECT_EQ(std::isinf(found[i]), std::isinf(expected[i])) << i;
    } else {
      EXPECT_NEAR(found[i], expected[i], 2e-5 * (1 + std::abs(expected[i]))) << i;
    }
  }
}

TEST(FindTexture, IsWhereTheGradientExceedsTheNoise) {
  const std::vector<float> value = Patch(1, 0.05), attenuation(value.size(), 0.5F);
  const SensorNoise noise{.read = 40, .shot = 3};
  constexpr float kLeast = 3;
  const int first = 5 * kSize + 1, count = kSize - 2;
  std::vector<int> textured(count);
  FindTexture(&value[first], &attenuation[first], kSize, count, noise, kLeast, textured.data());
  int flat = 0, steep = 0;
  for (int i = 0; i < count; ++i) {
    const auto at = static_cast<size_t>(first + i);
    const double gx = (value[at + 1] - value[at - 1]) / 2.0,
                 gy = (value[at + kSize] - value[at - kSize]) / 2.0;
    // var(raw / v) of the raw value v * value.
    const double variance = (40 + 3 * 0.5 * std::max(value[at], 0.F)) / (0.5 * 0.5);
    const bool expected = !std::isnan(value[at]) && gx * gx + gy * gy > kLeast * variance;
    EXPECT_EQ(textured[static_cast<size_t>(i)], expected ? 1 : 0) << i;
    ++(expected ? steep : flat);
  }
  EXPECT_GT(flat, 3);
  EXPECT_GT(steep, 3);
}

TEST(RemoveDisplacement, IsTheDisplacementAlongTheSlopeOfTheAttenuation) {
  const std::vector<float> displaced = Patch(2, 0.1);
  Random random(3);
  std::vector<float> attenuation(displaced.size()), z(kSize);
  for (float& v : attenuation) v = static_cast<float>(random.Uniform(0.4, 1));
  for (float& each : z) each = static_cast<float>(random.Uniform(-0.3, 0.3));
  const LinearInZ vignetting{.offset = 0.7F, .slope = -1.9F};
  const int first = 7 * kSize + 1, count = kSize - 2;
  std::vector<float> value(count), expected(count);
  RemoveDisplacement(&displaced[first],
                     kSize,
                     &attenuation[first],
                     kSize,
                     z.data(),
                     vignetting,
                     count,
                     value.data());
  // Half the difference of what is known: over two pixels; else over one, the right one first.
  const auto slope = [](double before, double here, double after) {
    if (!std::isnan(before) && !std::isnan(after)) return (after - before) / 2;
    if (!std::isnan(after - here)) return after - here;
    if (!std::isnan(here - before)) return 1.5 * (here - before);
    return 0.0;
  };
  for (int i = 0; i < count; ++i) {
    const auto at = static_cast<size_t>(first + i);
    const auto log_slope = [&](size_t before, size_t after) {
      return (attenuation[after] - attenuation[before]) /
             static_cast<double>(attenuation[after] + attenuation[before]);
    };
    const double along =
        slope(displaced[at - 1], displaced[at], displaced[at + 1]) * log_slope(at - 1, at + 1) +
        slope(displaced[at - kSize], displaced[at], displaced[at + kSize]) *
            log_slope(at - kSize, at + kSize);
    const double k = 0.7 - 1.9 * z[static_cast<size_t>(i)];
    expected[static_cast<size_t>(i)] = static_cast<float>(displaced[at] - k * along);
  }
  ExpectSame(value, expected);
}

TEST(AddDifferences, AddsWhereBothPatchesAreKnown) {
  const std::vector<float> reference = Patch(4, 0.1), other = Patch(5, 0.1);
  const ShiftedPatches patches{.reference = reference.data(),
                               .other = other.data(),
                               .stride = kSize,
                               .whole_shift = 2 * kSize + 1,
                               .shift_x = 0.3F,
                               .shift_y = 0.8F,
                               .overlap = {4, 17, 3, 15}};
  // Beside, on both edges of and within the overlap; higher and lower than it.
  const std::vector<PatchBlock> blocks{{0, 1, 20}, {8, 5, 9}, {16, 0, 20}, {-4, 3, 9}, {17, 3, 9}};
  const size_t size = kSize * kSize + 16;
  std::vector<float> cost(size, 1), count(size, 2), expected_cost = cost, expected_count = count;
  AddDifferences(patches, std::span(blocks).first(3), cost.data(), count.data());
  for (const PatchBlock& block : std::span(blocks).first(3)) {
    for (int y = std::max(block.top, 3); y < std::min(block.bottom, 15); ++y) {
      for (int x = block.column; x < block.column + 8; ++x) {
        const auto at = static_cast<size_t>(y * kSize + x), from = at + 2 * kSize + 1;
        const double upper = other[from] + 0.3 * (other[from + 1] - other[from]),
                     lower = other[from + kSize] +
                             0.3 * (other[from + kSize + 1] - other[from + kSize]),
                     difference = std::abs(upper + 0.8 * (lower - upper) - reference[at]);
        if (std::isnan(difference)) continue;
        expected_cost[at] += static_cast<float>(difference);
        expected_count[at] += 1;
      }
    }
  }
  ExpectSame(cost, expected_cost);
  ExpectSame(count, expected_count);
  // Blocks beside the overlap are passed over.
  cost.assign(size, 1);
  const std::vector<PatchBlock> beside{{-4, 3, 9}, {17, 3, 9}};
  AddDifferences(patches, beside, cost.data(), count.data());
  ExpectSame(cost, std::vector<float>(size, 1));
}

TEST(WindowMeans, AreThoseOfThreeByThreePixels) {
  const std::vector<float> cost = Patch(6);
  Random random(7);
  std::vector<float> count(cost.size());
  for (float& each : count) each = std::floor(static_cast<float>(random.Uniform(0, 3)));
  const std::vector<PatchBlock> blocks{{1, 2, 9}, {9, 0, 5}};
  std::vector<float> mean(cost.size(), -1), expected = mean;
  constexpr float kLeast = 9;
  WindowMeans(blocks, kSize, cost.data(), count.data(), kLeast, mean.data());
  int few = 0;
  for (const PatchBlock& block : blocks) {
    for (int y = block.top + 1; y + 1 < block.bottom; ++y) {
      for (int x = block.column; x < block.column + 8; ++x) {
        double sum = 0, all = 0;
        for (int dy = -1; dy <= 1; ++dy) {
          for (int dx = -1; dx <= 1; ++dx) {
            const auto at = static_cast<size_t>((y + dy) * kSize + x + dx);
            sum += cost[at];
            all += count[at];
          }
        }
        few += all < kLeast ? 1 : 0;
        expected[static_cast<size_t>(y * kSize + x)] =
            all < kLeast ? std::numeric_limits<float>::infinity() : static_cast<float>(sum / all);
      }
    }
  }
  EXPECT_GT(few, 10);
  ExpectSame(mean, expected);
}

TEST(AddEquations, AreTheNormalEquationsOfTheDefinition) {
  const std::vector<float> patch = Patch(8, 0.05);
  const OtherPatch other{.value = patch.data(),
                         .size = kSize,
                         .offset_x = 1.3F,
                         .offset_y = -0.6F,
                         .baseline_x = 9,
                         .baseline_y = -14,
                         .defocus = {0.4F, -0.9F},
                         .misfit = 0.02F};
  Random random(9);
  TexturedPixels pixels;
  constexpr int kPixels = 200;
  for (int i = 0; i < kPixels; ++i) {
    const auto number = [&](double low, double high) {
      return static_cast<float>(random.Uniform(low, high));
    };
    pixels.x.push_back(number(0, kSize - 1));  // some are seen beyond the patch
    pixels.y.push_back(number(0, kSize - 1));
    pixels.z.push_back(number(-0.3, 0.3));
    pixels.value.push_back(number(10, 200));
    pixels.gradient_x.push_back(number(-20, 20));
    pixels.gradient_y.push_back(number(-20, 20));
    pixels.laplacian.push_back(number(-10, 10));
    pixels.variance.push_back(number(5, 50));
    pixels.at.push_back(i);
  }
  pixels.ResetSums();
  for (int time = 0; time < 2; ++time) AddEquations(other, &pixels);
  int within = 0, known = 0;
  for (size_t i = 0; i < kPixels; ++i) {
    const double z = pixels.z[i], u = pixels.x[i] + 1.3 - 9 * z, v = pixels.y[i] - 0.6 + 14 * z;
    if (u < 0 || v < 0 || u > kSize - 1 || v > kSize - 1) continue;
    ++within;
    const int column = std::min(static_cast<int>(u), kSize - 2),
              row = std::min(static_cast<int>(v), kSize - 2);
    const double fx = u - column, fy = v - row;
    const auto at = static_cast<size_t>(row * kSize + column);
    const double upper = patch[at] + fx * (patch[at + 1] - patch[at]),
                 lower = patch[at + kSize] + fx * (patch[at + kSize + 1] - patch[at + kSize]);
    const double blur = 0.4 - 0.9 * z + (fx * (1 - fx) + fy * (1 - fy)) / 4;
    const double error =
        upper + fy * (lower - upper) - pixels.value[i] - blur * pixels.laplacian[i];
    const double slope = -(9 * pixels.gradient_x[i] - 14 * pixels.gradient_y[i]);
    const double variance = 2 * pixels.variance[i] + 0.02 * slope * slope / (9 * 9 + 14 * 14);
    const double weight = 1 / (variance + error * error / kCauchyWidthSquared<double>);
    const bool is_known = !std::isnan(error);
    known += is_known ? 1 : 0;
    const double expected[] = {
        weight * slope * error, weight * slope * slope, weight * variance, 1};
    const float found[] = {pixels.sum_gradient[i],
                           pixels.sum_information[i],
                           pixels.sum_agreement[i],
                           pixels.sum_count[i]};
    for (size_t k = 0; k < 4; ++k) {
      const double twice = is_known ? 2 * expected[k] : 0;
      // The interpolation's rounding is that of floats.
      EXPECT_NEAR(found[k], twice, 1e-3 * std::abs(twice) + 1e-4) << i << " " << k;
    }
  }
  EXPECT_GT(within, 100);
  EXPECT_LT(known, within);
}

TEST(TexturedPixels, KeepsTheFlaggedOnes) {
  TexturedPixels pixels;
  for (int i = 0; i < 3; ++i) {
    for (auto* each : {&pixels.x,
                       &pixels.y,
                       &pixels.z,
                       &pixels.value,
                       &pixels.gradient_x,
                       &pixels.gradient_y,
                       &pixels.laplacian,
                       &pixels.variance}) {
      each->push_back(static_cast<float>(i));
    }
    pixels.at.push_back(i);
  }
  pixels.Keep({1, 0, 1});
  for (const auto& each : {pixels.x,
                           pixels.y,
                           pixels.z,
                           pixels.value,
                           pixels.gradient_x,
                           pixels.gradient_y,
                           pixels.laplacian,
                           pixels.variance}) {
    EXPECT_THAT(each, ::testing::ElementsAre(0, 2));
  }
  EXPECT_THAT(pixels.at, ::testing::ElementsAre(0, 2));
}

TEST(SumWindow, IsOfTheDepthsThatAgreeWithTheMiddleOne) {
  Random random(10);
  constexpr int kStride = 20;
  for (const int size : {3, 5, 8}) {
    std::vector<float> z(kStride * 10), information(z.size());
    for (size_t i = 0; i < z.size(); ++i) {
      z[i] = static_cast<float>(random.Uniform(0, 0.4));
      information[i] =
          random.Uniform(0, 1) < 0.3 ? 0 : static_cast<float>(random.Uniform(200, 900));
    }
    const auto middle = static_cast<size_t>(size / 2 * kStride + size / 2);
    information[middle] = 500;
    constexpr double kMost = 1.5;
    const WindowSums sums = SumWindow(z.data(), information.data(), kStride, size, kMost);
    double all = 0, agreeing = 0, weights = 0, weighted = 0;
    for (int row = 0; row < size; ++row) {
      for (int column = 0; column < size; ++column) {
        const auto at = static_cast<size_t>(row * kStride + column);
        if (!(information[at] > 0)) continue;
        ++all;
        const double sigma = std::sqrt(1 / information[at] + 1 / information[middle]);
        if (std::abs(z[at] - z[middle]) > kMost * sigma) continue;
        ++agreeing;
        weights += information[at];
        weighted += information[at] * z[at];
      }
    }
    EXPECT_EQ(sums.all, all);
    EXPECT_EQ(sums.agreeing, agreeing);
    EXPECT_LT(agreeing, all);
    EXPECT_NEAR(sums.information, weights, 1e-5 * weights);
    EXPECT_NEAR(sums.z, weighted, 1e-5 * weighted);
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
