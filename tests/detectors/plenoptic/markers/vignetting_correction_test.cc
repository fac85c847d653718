// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/vignetting_correction.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "tests/detectors/plenoptic/markers/simulated_measurements.h"

namespace plenocal::internal {
namespace {

constexpr std::array kFocus{0.40, 0.32, 0.24};  // inverse virtual depth at which a type is sharp

/// k of a pixel's own area and of the aperture, px^2.
Eigen::Vector2d TrueK(int type, double z) { return {0.2, 10 * kFocus[type] * (kFocus[type] - z)}; }

struct Scene {
  std::vector<RawMeasurements> measured,
      true_view;  // with the shifts and without them, equal noise
};

Scene MakeScene(double shift, int types) {
  const auto make = [&](bool shifted) {
    return SimulateMeasurements(types, [&](const Eigen::Vector2d& offset, MarkerMeasurement* o) {
      // None up to 3 px from the centre; the aperture's begins later.
      const double r = offset.norm(), fall = std::max(0.0, r - 3) / std::max(r, 1e-3);
      o->vignetting_sensitivity << 0.1 * fall * offset, 0.1 * fall * fall * offset;
      if (shifted)
        o->Move(shift * o->vignetting_sensitivity * TrueK(o->lens_type, o->inverse_depth));
    });
  };
  return {make(true), make(false)};
}

TEST(ApertureShape, IsThatOfACutDisc) {
  EXPECT_EQ(ApertureShape(1), 0);
  EXPECT_EQ(ApertureShape(1.01), 0);
  for (const double d : {0.4, 0.6, 0.8, 0.95}) {
    const double segment = (std::acos(d) - d * std::sqrt(1 - d * d)) / std::numbers::pi;
    EXPECT_NEAR(ApertureShape(1 - segment), 4.0 / 3 * (1 - d * d), 0.02) << d;
  }
}

TEST(CorrectVignettingDisplacement, FindsThemByTypeAndDepth) {
  Scene scene = MakeScene(1, 3);
  const double before = Difference(scene.measured, scene.true_view);
  EXPECT_GT(before, 0.1);
  CorrectVignettingDisplacement(3, &scene.measured);
  EXPECT_LT(Difference(scene.measured, scene.true_view), before / 10);
}

TEST(CorrectVignettingDisplacement, FindsThoseOfASingleType) {
  Scene scene = MakeScene(1, 1);
  const double before = Difference(scene.measured, scene.true_view);
  CorrectVignettingDisplacement(1, &scene.measured);
  EXPECT_LT(Difference(scene.measured, scene.true_view), before / 10);
}

TEST(CorrectVignettingDisplacement, IsAsUncertainAsTheFormula) {
  // A tenth of three terms that may err alike or against each other; noise adds little here.
  Scene scene = MakeScene(1, 3);
  const std::vector<RawMeasurements> before = scene.measured;
  const auto left = CorrectVignettingDisplacement(3, &scene.measured);
  for (size_t i = 0; i < before[0].size(); ++i) {
    const double moved = (scene.measured[0][i].Position() - before[0][i].Position()).norm();
    if (moved < 5 * kMicroNoise) continue;
    double square = 0;
    for (const double one : left[0][i]) square += one * one;
    EXPECT_GT(std::sqrt(square), 0.1 * moved / std::sqrt(3)) << i;
    EXPECT_LT(std::sqrt(square), 0.3 * moved) << i;
  }
}

TEST(CorrectVignettingDisplacement, FindsNoneWhereThereIsNone) {
  Scene scene = MakeScene(0, 3);
  CorrectVignettingDisplacement(3, &scene.measured);
  EXPECT_LT(Difference(scene.measured, scene.true_view), kMicroNoise);
}

TEST(CorrectVignettingDisplacement, AcceptsAnEmptySetAndOneOfASingleMicroImage) {
  std::vector<RawMeasurements> none;
  CorrectVignettingDisplacement(3, &none);
  EXPECT_TRUE(none.empty());
  Scene scene = MakeScene(0, 1);
  std::vector<RawMeasurements> one{{scene.measured[0][0]}};
  CorrectVignettingDisplacement(1, &one);
  // The displacement by the pixel itself is known before.
  const auto& before = scene.measured[0][0];
  for (Eigen::Index axis = 0; axis < 2; ++axis) {
    const auto i = static_cast<size_t>(axis);
    EXPECT_NEAR(one[0][0].observation.values[i],
                before.observation.values[i],
                0.5 * std::abs(before.vignetting_sensitivity(axis, 0)));
  }
}

}  // namespace
}  // namespace plenocal::internal
