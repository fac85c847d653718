// SPDX-License-Identifier: Apache-2.0
#include "detectors/vignetting_shift.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>

namespace plenocal::internal {
namespace {

constexpr std::array kFocus{0.40, 0.32, 0.24};  // inverse virtual depth at which a type is sharp
constexpr double kNoise = 0.01;                 // px
constexpr double kPitch = 18;

/// k of a pixel's own area and of the aperture, px^2.
Eigen::Vector2d TrueK(int type, double z) { return {0.2, 10 * kFocus[type] * (kFocus[type] - z)}; }

struct Scene {
  std::vector<MicroView> measured, true_view;  // with the shifts and without them, equal noise
};

/// Markers at many depths, each in the micro images around it, of interleaved types.
Scene MakeScene(double shift, int types) {
  std::mt19937 engine(7);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0, 1);
  Scene scene;
  for (int frame = 0; frame < 10; ++frame) {
    MicroView measured, true_view;
    for (int marker = 0; marker < 60; ++marker) {
      const double z = 0.25 + 0.1 * uniform(engine);
      const Eigen::Vector2d q(400 + kPitch * uniform(engine), 300 + kPitch * uniform(engine));
      for (int i = -6; i <= 6; ++i) {
        for (int j = -6; j <= 6; ++j) {
          const Eigen::Vector2d c = Eigen::Vector2d(400, 300) +
                                    kPitch * Eigen::Vector2d(i + 0.5 * j, j * std::sqrt(3) / 2);
          const Eigen::Vector2d offset = (q - c) * z;
          const double r = offset.norm();
          if (r > 0.3 * kPitch) continue;
          const int type = ((i - j) % 3 + 3) % 3 % types;
          // None up to 3 px from the centre; the aperture's begins later.
          const double fall = std::max(0.0, r - 3) / std::max(r, 1e-3);
          Eigen::Matrix2d pull;
          pull << 0.1 * fall * offset, 0.1 * fall * fall * offset;
          MicroObservation o{
              .seen = {.marker = marker, .values = {0, 0, c.x(), c.y()}, .sigma = kNoise},
              .inverse_depth = z,
              .pull = pull,
              .type = type};
          const Eigen::Vector2d noise(kNoise * normal(engine), kNoise * normal(engine));
          for (const bool shifted : {false, true}) {
            Eigen::Vector2d x = c + offset + noise;
            if (shifted) x += shift * pull * TrueK(type, z);
            o.seen.values[0] = x.x();
            o.seen.values[1] = x.y();
            (shifted ? measured : true_view).push_back(o);
          }
        }
      }
    }
    scene.measured.push_back(measured);
    scene.true_view.push_back(true_view);
  }
  return scene;
}

/// Largest difference of two sets of measurements, px.
double Difference(const std::vector<MicroView>& a, const std::vector<MicroView>& b) {
  double largest = 0;
  for (size_t v = 0; v < a.size(); ++v) {
    for (size_t i = 0; i < a[v].size(); ++i) {
      for (size_t k = 0; k < 2; ++k) {
        largest = std::max(largest, std::abs(a[v][i].seen.values[k] - b[v][i].seen.values[k]));
      }
    }
  }
  return largest;
}

TEST(ApertureShape, IsThatOfACutDisc) {
  EXPECT_EQ(ApertureShape(1), 0);
  EXPECT_EQ(ApertureShape(1.01), 0);
  for (const double d : {0.4, 0.6, 0.8, 0.95}) {
    const double segment = (std::acos(d) - d * std::sqrt(1 - d * d)) / std::numbers::pi;
    EXPECT_NEAR(ApertureShape(1 - segment), 4.0 / 3 * (1 - d * d), 0.02) << d;
  }
}

TEST(RemoveVignettingShifts, FindsThemByTypeAndDepth) {
  Scene scene = MakeScene(1, 3);
  const double before = Difference(scene.measured, scene.true_view);
  EXPECT_GT(before, 0.1);
  RemoveVignettingShifts(3, &scene.measured);
  EXPECT_LT(Difference(scene.measured, scene.true_view), before / 10);
}

TEST(RemoveVignettingShifts, FindsThoseOfASingleType) {
  Scene scene = MakeScene(1, 1);
  const double before = Difference(scene.measured, scene.true_view);
  RemoveVignettingShifts(1, &scene.measured);
  EXPECT_LT(Difference(scene.measured, scene.true_view), before / 10);
}

TEST(RemoveVignettingShifts, FindsNoneWhereThereIsNone) {
  Scene scene = MakeScene(0, 3);
  RemoveVignettingShifts(3, &scene.measured);
  EXPECT_LT(Difference(scene.measured, scene.true_view), kNoise);
}

TEST(RemoveVignettingShifts, AcceptsAnEmptySetAndOneOfASingleMicroImage) {
  std::vector<MicroView> none;
  RemoveVignettingShifts(3, &none);
  EXPECT_TRUE(none.empty());
  Scene scene = MakeScene(0, 1);
  std::vector<MicroView> one{{scene.measured[0][0]}};
  RemoveVignettingShifts(1, &one);
  // What any pixel does is known before.
  const auto& before = scene.measured[0][0];
  for (Eigen::Index axis = 0; axis < 2; ++axis) {
    const auto i = static_cast<size_t>(axis);
    EXPECT_NEAR(
        one[0][0].seen.values[i], before.seen.values[i], 0.5 * std::abs(before.pull(axis, 0)));
  }
}

}  // namespace
}  // namespace plenocal::internal
