// SPDX-License-Identifier: Apache-2.0
#include "detectors/templates/cell_template.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace plenocal::internal {
namespace TEST_FILE {

constexpr int kCells = 6;

/// Cells of -1 and 1 without any pattern.
std::vector<float> Cells() {
  std::mt19937 random(3);
  std::vector<float> cells(kCells * kCells);
  for (float& cell : cells) cell = random() % 2 == 0 ? -1.f : 1.f;
  return cells;
}

/// `shear` 0: axes at right angles; larger: more and more acute.
Eigen::Matrix3f Homography(float shear) {
  Eigen::Matrix3f G;
  G << 0.31f, 0.02f + shear * 0.3f, 2.9f, -0.02f, 0.3f, 3.1f, 0.003f, -0.002f, 1;
  return G;
}

/// The cells' value at a point of their plane; the outermost go on without end.
double Sharp(const std::vector<float>& cells, const Eigen::Vector2f& place) {
  const auto cell = [](float at) {
    return std::clamp(static_cast<int>(std::floor(at)), 0, kCells - 1);
  };
  return cells[cell(place.y()) * kCells + cell(place.x())];
}

/// Their image blurred by a Gaussian, summed over a grid of `step` blurs.
double Blurred(const std::vector<float>& cells,
               const Eigen::Matrix3f& G,
               double blur,
               double x,
               double y,
               double step = 0.025) {
  constexpr double kReach = 4.5;  // blurs
  double sum = 0, weights = 0;
  for (double a = -kReach; a <= kReach; a += step) {
    for (double b = -kReach; b <= kReach; b += step) {
      const double weight = std::exp(-(a * a + b * b) / 2);
      const Eigen::Vector3f at(
          static_cast<float>(x + blur * a), static_cast<float>(y + blur * b), 1);
      sum += weight * Sharp(cells, (G * at).hnormalized());
      weights += weight;
    }
  }
  return sum / weights;
}

/// The same in pixels of side 1, which have an area.
double BlurredInPixels(
    const std::vector<float>& cells, const Eigen::Matrix3f& G, double blur, double x, double y) {
  constexpr int kParts = 8;  // of a pixel's side
  double sum = 0;
  for (int i = 0; i < kParts * kParts; ++i) {
    const double right = (i % kParts + 0.5) / kParts - 0.5;
    const double down = (i / kParts + 0.5) / kParts - 0.5;
    sum += Blurred(cells, G, blur, x + right, y + down, 0.2);
  }
  return sum / (kParts * kParts);
}

CellTemplate::Drawn Draw(CellTemplate* drawing,
                         const Eigen::Matrix3f& G,
                         float blur,
                         float x,
                         float y,
                         float pixel = 0) {
  CellTemplate::Drawn drawn;
  drawing->Draw(G, blur, pixel, Lanes{} + x, Lanes{} + y, &drawn);
  return drawn;
}

class CellDrawingTest : public ::testing::TestWithParam<float> {};

TEST_P(CellDrawingTest, IsTheBlurredImageOfTheCells) {
  const std::vector<float> cells = Cells();
  CellTemplate drawing(cells, kCells);
  const Eigen::Matrix3f G = Homography(GetParam());
  for (const float blur : {0.5f, 1.1f}) {
    for (float x = -9; x <= 9; x += 2.9f) {
      for (float y = -8; y <= 8; y += 3.1f) {
        // The homography is affine within the blur only nearly.
        EXPECT_NEAR(Draw(&drawing, G, blur, x, y).value[0], Blurred(cells, G, blur, x, y), 0.02)
            << "at " << x << ", " << y << ", blur " << blur;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Shears, CellDrawingTest, ::testing::Values(0.f, 0.25f, 0.7f));

TEST(CellTemplate, InSharpImagesThePixelsHaveAnArea) {
  const std::vector<float> cells = Cells();
  CellTemplate drawing(cells, kCells);
  const float rest = 0.2f, blur = std::hypot(rest, std::sqrt(1 / 12.f));
  // Along the pixels' rows, at an angle to them, and with axes not quite at right angles.
  for (const float angle : {0.f, 0.4f, 0.8f}) {
    Eigen::Matrix3f turn = Eigen::Matrix3f::Identity();
    turn.topLeftCorner<2, 2>() = Eigen::Rotation2Df(angle).toRotationMatrix();
    const Eigen::Matrix3f G = Homography(0.02f) * turn;
    double with = 0, without = 0;
    for (float x = -5; x <= 5; x += 0.7f) {
      for (const float y : {-3.2f, 0.4f, 3.1f}) {
        const double truth = BlurredInPixels(cells, G, rest, x, y);
        with = std::max(with, std::abs(Draw(&drawing, G, blur, x, y, 1).value[0] - truth));
        without = std::max(without, std::abs(Draw(&drawing, G, blur, x, y).value[0] - truth));
      }
    }
    EXPECT_LT(with, 0.03) << "of a contrast of 2, at " << angle;
    // Diagonally a square is nearly bell-shaped.
    EXPECT_LT(with, (angle < 0.6f ? 0.5 : 1) * without) << angle;
  }
}

TEST(CellTemplate, DerivativesWithPixelsAreThoseOfTheValue) {
  CellTemplate drawing(Cells(), kCells);
  const float blur = 0.36f, h = 0.01f;
  const Eigen::Matrix3f G = Homography(0.02f);
  const auto value = [&](float u, float v, float b, float x) {
    Eigen::Matrix3f moved = Eigen::Matrix3f::Identity();
    moved(0, 2) = u;
    moved(1, 2) = v;
    const Eigen::Matrix3f there = moved * G;
    return Draw(&drawing, there / there(2, 2), b, x, 0.4f, 1).value[0];
  };
  int checked = 0;
  for (float x = -5; x <= 5; x += 0.2f) {
    const auto drawn = Draw(&drawing, G, blur, x, 0.4f, 1);
    const float by_u = (value(h, 0, blur, x) - value(-h, 0, blur, x)) / (2 * h);
    const float by_v = (value(0, h, blur, x) - value(0, -h, blur, x)) / (2 * h);
    const float by_blur = (value(0, 0, blur + h, x) - value(0, 0, blur - h, x)) / (2 * h);
    EXPECT_NEAR(drawn.by_u[0], by_u, 0.05 + 0.03 * std::abs(by_u)) << x;
    EXPECT_NEAR(drawn.by_v[0], by_v, 0.05 + 0.03 * std::abs(by_v)) << x;
    EXPECT_NEAR(drawn.by_blur[0], by_blur, 0.05 + 0.03 * std::abs(by_blur)) << x;
    checked += std::abs(by_u) > 0.3;
  }
  EXPECT_GE(checked, 4) << "places where anything changes";
}

TEST(CellTemplate, DerivativesAreThoseOfTheBlurredImage) {
  const std::vector<float> cells = Cells();
  CellTemplate drawing(cells, kCells);
  const Eigen::Matrix3f G = Homography(0.1f);
  const double blur = 0.9, h = 0.05;
  // The same cells moved by (u, v) in their plane.
  const auto value = [&](double u, double v, double b, double x, double y) {
    Eigen::Matrix3f moved = Eigen::Matrix3f::Identity();
    moved(0, 2) = static_cast<float>(u);
    moved(1, 2) = static_cast<float>(v);
    return Blurred(cells, moved * G, b, x, y);
  };
  int checked = 0;
  for (const double x : {-6.3, -1.2, 2.7, 5.1}) {
    for (const double y : {-4.4, 0.3, 3.9}) {
      const auto drawn =
          Draw(&drawing, G, static_cast<float>(blur), static_cast<float>(x), static_cast<float>(y));
      const double by_u = (value(h, 0, blur, x, y) - value(-h, 0, blur, x, y)) / (2 * h);
      const double by_v = (value(0, h, blur, x, y) - value(0, -h, blur, x, y)) / (2 * h);
      const double by_blur = (value(0, 0, blur + h, x, y) - value(0, 0, blur - h, x, y)) / (2 * h);
      EXPECT_NEAR(drawn.by_u[0], by_u, 0.05 + 0.03 * std::abs(by_u));
      EXPECT_NEAR(drawn.by_v[0], by_v, 0.05 + 0.03 * std::abs(by_v));
      EXPECT_NEAR(drawn.by_blur[0], by_blur, 0.05 + 0.03 * std::abs(by_blur));
      checked += std::abs(by_u) > 0.3;
    }
  }
  EXPECT_GE(checked, 4) << "places where anything changes";
}

TEST(CellTemplate, LiesBetweenGivenLines) {
  // Cells of unequal widths against the same pattern made of equal ones.
  const std::vector<float> two{-1, 1, 1, -1};
  CellTemplate between(two, std::vector<float>{0, 2, 3});
  std::vector<float> equal;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      equal.push_back(two[(row < 2 ? 0 : 2) + (column < 2 ? 0 : 1)]);
    }
  }
  CellTemplate cells(equal, 3);
  Eigen::Matrix3f G = Eigen::Matrix3f::Identity();
  for (const float x : {0.4f, 1.7f, 2.2f}) {
    for (const float y : {0.9f, 2.1f, 2.8f}) {
      const auto a = Draw(&between, G, 0.4f, x, y), b = Draw(&cells, G, 0.4f, x, y);
      EXPECT_NEAR(a.value[0], b.value[0], 1e-4) << x << ", " << y;
      EXPECT_NEAR(a.by_u[0], b.by_u[0], 1e-3) << x << ", " << y;
    }
  }
}

TEST(CellTemplate, ValueBeyondActsByItsShare) {
  CellTemplate drawing(Cells(), kCells);
  const Eigen::Matrix3f G = Homography(0);
  const auto at = [&](float beyond) {
    drawing.SetBeyond(beyond);
    return Draw(&drawing, G, 1.f, -6.5f, -1.f);
  };
  const auto low = at(-0.5f), high = at(0.5f);
  EXPECT_GT(low.by_beyond[0], 0.05f);
  EXPECT_NEAR(high.value[0] - low.value[0], low.by_beyond[0], 1e-3);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
