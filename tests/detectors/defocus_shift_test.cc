// SPDX-License-Identifier: Apache-2.0
#include "detectors/defocus_shift.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace plenocal::internal {
namespace {

constexpr std::array kFocus{0.40, 0.32, 0.24};   // inverse virtual depth at which a type is sharp
constexpr std::array kLambda{0.05, 0.06, 0.04};  // shift, relative to offset and defocus
constexpr double kNoise = 0.01, kBlurNoise = 0.02;  // px
constexpr double kPitch = 18;

struct Scene {
  std::vector<MicroView> measured, sharp;  // with the shifts, and as a pinhole would show it
};

/// Markers at many depths, each in the micro images around it, of interleaved types.
Scene MakeScene(double shift, int types) {
  std::mt19937 engine(7);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0, 1);
  Scene scene;
  for (int frame = 0; frame < 10; ++frame) {
    MicroView measured, sharp;
    for (int marker = 0; marker < 60; ++marker) {
      const double z = 0.25 + 0.1 * uniform(engine);
      const Eigen::Vector2d q(400 + kPitch * uniform(engine), 300 + kPitch * uniform(engine));
      for (int i = -6; i <= 6; ++i) {
        for (int j = -6; j <= 6; ++j) {
          const Eigen::Vector2d c = Eigen::Vector2d(400, 300) +
                                    kPitch * Eigen::Vector2d(i + 0.5 * j, j * std::sqrt(3) / 2);
          const Eigen::Vector2d offset = (q - c) * z;
          if (offset.norm() > 0.3 * kPitch) continue;
          const int type = ((i - j) % 3 + 3) % 3 % types;
          const double defocus = kFocus[type] - z;
          MicroObservation o{
              .seen = {.marker = marker, .values = {0, 0, c.x(), c.y()}, .sigma = kNoise},
              .inverse_depth = z,
              .blur = std::sqrt(0.1 + 10 * defocus * defocus) + kBlurNoise * normal(engine),
              .type = type};
          const Eigen::Vector2d noise(kNoise * normal(engine), kNoise * normal(engine));
          for (const bool shifted : {false, true}) {
            const double stretch = shifted ? 1 + shift * kLambda[type] * defocus : 1;
            const Eigen::Vector2d x = c + stretch * offset + noise;
            o.seen.values[0] = x.x();
            o.seen.values[1] = x.y();
            (shifted ? measured : sharp).push_back(o);
          }
        }
      }
    }
    scene.measured.push_back(measured);
    scene.sharp.push_back(sharp);
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

TEST(RemoveDefocusShifts, FindsThemFromTheDifferencesOfTheTypes) {
  Scene scene = MakeScene(1, 3);
  // 5 px off the centre, out of focus by 0.15: 0.04 px.
  const double before = Difference(scene.measured, scene.sharp);
  EXPECT_GT(before, 0.03);
  RemoveDefocusShifts(3, &scene.measured);
  EXPECT_LT(Difference(scene.measured, scene.sharp), before / 5);
}

TEST(RemoveDefocusShifts, LeavesMeasurementsAsTheyAreWhereThereIsNone) {
  Scene scene = MakeScene(0, 3);
  RemoveDefocusShifts(3, &scene.measured);
  EXPECT_EQ(Difference(scene.measured, scene.sharp), 0);
}

TEST(RemoveDefocusShifts, LeavesASingleTypeAsItIs) {
  Scene scene = MakeScene(1, 1);
  const std::vector<MicroView> before = scene.measured;
  RemoveDefocusShifts(1, &scene.measured);
  EXPECT_EQ(Difference(scene.measured, before), 0);
}

TEST(RemoveDefocusShifts, AcceptsAnEmptySet) {
  std::vector<MicroView> none;
  RemoveDefocusShifts(3, &none);
  EXPECT_TRUE(none.empty());
}

}  // namespace
}  // namespace plenocal::internal
