// SPDX-License-Identifier: Apache-2.0
#include "detectors/templates/disc_template.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

namespace plenocal::internal {
namespace TEST_FILE {

/// A disc of radius 1.1 seen a little in perspective, some 5 px large.
Eigen::Matrix3f Homography() {
  Eigen::Matrix3f G;
  G << 0.2f, 0.02f, 0.1f, -0.01f, 0.24f, -0.05f, 0.003f, -0.002f, 1;
  return G;
}

/// The disc's image, blurred by summing over a fine grid.
double Blurred(const Eigen::Matrix3f& G, double radius, double blur, double x, double y) {
  constexpr double kStep = 0.02, kReach = 4.5;  // blurs
  double sum = 0, weights = 0;
  for (double a = -kReach; a <= kReach; a += kStep) {
    for (double b = -kReach; b <= kReach; b += kStep) {
      const double weight = std::exp(-(a * a + b * b) / 2);
      const Eigen::Vector3f place(
          static_cast<float>(x + blur * a), static_cast<float>(y + blur * b), 1);
      sum += (G * place).hnormalized().norm() < radius ? weight : -weight;
      weights += weight;
    }
  }
  return sum / weights;
}

DiscTemplate::Drawn Draw(const DiscTemplate& drawing,
                         const Eigen::Matrix3f& G,
                         float blur,
                         float x,
                         float y,
                         float pixel = 0) {
  DiscTemplate::Drawn drawn;
  drawing.Draw(G, blur, pixel, Lanes{} + x, Lanes{} + y, &drawn);
  return drawn;
}

TEST(DiscTemplate, IsTheBlurredDisc) {
  const float radius = 1.1f, blur = 0.7f;
  const DiscTemplate drawing(radius);
  for (float x = -8; x <= 8; x += 1.3f) {
    for (float y = -7; y <= 7; y += 1.9f) {
      EXPECT_NEAR(Draw(drawing, Homography(), blur, x, y).value[0],
                  Blurred(Homography(), radius, blur, x, y),
                  0.01)
          << x << " " << y;
    }
  }
}

class DiscDerivatives : public ::testing::TestWithParam<float> {};

TEST_P(DiscDerivatives, AreThoseOfTheValue) {
  const float blur = 0.7f, h = 0.01f;
  const Eigen::Matrix3f G = Homography();
  const auto value = [&](float radius, float b, float u, float v) {
    Eigen::Matrix3f moved = Eigen::Matrix3f::Identity();
    moved(0, 2) = u, moved(1, 2) = v;
    return Draw(DiscTemplate(radius), moved * G / (moved * G)(2, 2), b, 3.1f, 2.2f, GetParam())
        .value[0];
  };
  const auto drawn = Draw(DiscTemplate(1.1f), G, blur, 3.1f, 2.2f, GetParam());
  ASSERT_LT(std::abs(drawn.value[0]), 0.9f);
  // Steepness and curvature of the edge are taken as constant: their part is below a tenth.
  const double close = 0.1;
  const auto near = [&](float slope, float plus, float minus) {
    EXPECT_NEAR(slope, (plus - minus) / (2 * h), close * std::max(1.f, std::abs(slope)));
  };
  near(drawn.by_u[0], value(1.1f, blur, h, 0), value(1.1f, blur, -h, 0));
  near(drawn.by_v[0], value(1.1f, blur, 0, h), value(1.1f, blur, 0, -h));
  near(drawn.by_radius[0], value(1.1f + h, blur, 0, 0), value(1.1f - h, blur, 0, 0));
  near(drawn.by_blur[0], value(1.1f, blur + h, 0, 0), value(1.1f, blur - h, 0, 0));
}

INSTANTIATE_TEST_SUITE_P(SidesOfPixels, DiscDerivatives, ::testing::Values(0.f, 1.f));

TEST(DiscTemplate, InSharpImagesThePixelsHaveAnArea) {
  Eigen::Matrix3f G = Eigen::Matrix3f::Identity() / 10;  // a radius of 10 px
  G(2, 2) = 1;
  const float rest = 0.2f, blur = std::hypot(rest, std::sqrt(1 / 12.f));
  // At the edge to the right, which is straight within a pixel: a part of it is beyond the edge.
  const auto truth = [&](double beyond) {
    double sum = 0;
    for (int i = 0; i < 100; ++i) {
      sum += std::erf((beyond - (i + 0.5) / 100 + 0.5) / rest / std::sqrt(2)) / 100;
    }
    return sum;
  };
  for (const float inside : {-0.4f, -0.25f, 0.f, 0.25f, 0.4f}) {
    EXPECT_NEAR(Draw(DiscTemplate(1), G, blur, 10 - inside, 0, 1).value[0], truth(inside), 0.02)
        << inside;
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
