// SPDX-License-Identifier: Apache-2.0
#include "detectors/lens_curvature.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "detectors/lens_bend.h"

namespace plenocal {
namespace {

const Eigen::Vector2d kSize(640, 480);
constexpr double kSigma = 2e-4;  // 1/px

const LensShape kTruth{0.01, -0.02, -0.21, 0.07, -0.01, 0.01, 0};

/// Of an edge 60 px long.
internal::EdgeBend Edge(const LensShape& shape,
                        const Eigen::Vector2d& place,
                        const Eigen::Vector2d& normal) {
  return {internal::LensBend(shape, place, kSize), {30 * normal.y(), -30 * normal.x()}, normal};
}

/// Of edges under a weak lens, where all is linear.
std::vector<LensReading> Readings(int count, std::mt19937* random) {
  std::uniform_real_distribution<double> uniform(0, 1);
  std::normal_distribution<double> normal;
  std::vector<LensReading> readings;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector2d place(uniform(*random) * kSize.x(), uniform(*random) * kSize.y());
    const double angle = 2 * std::numbers::pi * uniform(*random);
    const Eigen::Vector2d across(std::cos(angle), std::sin(angle));
    const LensShape row = Edge(LensShape::Zero(), place, across).by_shape;
    const double size = row.norm(), sigma = kSigma / size;
    readings.push_back(
        {row / size, row.dot(kTruth) / size + sigma * normal(*random), sigma * sigma});
  }
  return readings;
}

TEST(LensCurvature, IsLearnedFromManyUncertainReadings) {
  std::mt19937 random(5);
  const LensCurvature lens(Readings(20000, &random));
  for (int i = 0; i < 5; ++i) {
    const LensShape axis = LensShape::Unit(i);
    EXPECT_NEAR(lens.shape()[i], kTruth[i], 3 * std::sqrt(lens.Variance(axis))) << i;
  }
  EXPECT_LT((lens.shape() - kTruth).head<3>().norm(), 0.03);
}

TEST(LensCurvature, SaysHowUncertainItIs) {
  double chi2 = 0;
  int n = 0;
  for (unsigned seed = 0; seed < 100; ++seed) {
    std::mt19937 random(seed);
    const LensCurvature lens(Readings(4000, &random));
    for (const Eigen::Vector2d& place : {Eigen::Vector2d(100, 100), Eigen::Vector2d(500, 300)}) {
      for (const Eigen::Vector2d& normal : {Eigen::Vector2d(1, 0), Eigen::Vector2d(0, 1)}) {
        const LensShape row = Edge(LensShape::Zero(), place, normal).by_shape;
        const double error = row.dot(lens.shape() - kTruth);
        chi2 += error * error / lens.Variance(row);
        ++n;
      }
    }
  }
  EXPECT_GT(chi2 / n, 0.7);
  EXPECT_LT(chi2 / n, 1.3);
}

TEST(LensCurvature, IsNoneWithoutReadingsAndSmallForFew) {
  EXPECT_EQ(LensCurvature({}).shape(), LensShape::Zero());
  std::mt19937 random(7);
  const auto readings = Readings(4, &random);
  const LensShape row = Edge(LensShape::Zero(), {600, 40}, Eigen::Vector2d::UnitY()).by_shape;
  EXPECT_LT(std::abs(row.dot(LensCurvature(readings).shape())), 3 * kSigma);
}

/// Where the lens' shape says that something would be, px.
Eigen::Vector2d Undistorted(const LensShape& shape, const Eigen::Vector2d& x) {
  const double radius = kSize.norm() / 2;
  const Eigen::Vector2d p = (x - (kSize - Eigen::Vector2d::Ones()) / 2) / radius;
  const double s = p.squaredNorm();
  Eigen::Vector2d shift = shape.head<2>() * s;
  for (int n = 1; n <= kRadialOrders; ++n) shift += shape[n + 1] * std::pow(s, n) * p;
  return radius * (p - shift);
}

/// B(d) about a place.
Eigen::Vector2d Bend(const LensShape& shape,
                     const Eigen::Vector2d& place,
                     const Eigen::Vector2d& d) {
  constexpr double kStep = 1e-3;
  Eigen::Matrix2d J;
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector2d step = kStep * Eigen::Vector2d::Unit(i);
    J.col(i) = (Undistorted(shape, place + step) - Undistorted(shape, place - step)) / (2 * kStep);
  }
  return d - J.inverse() * (Undistorted(shape, place + d) - Undistorted(shape, place));
}

TEST(LensBend, IsWhatIsNotLinear) {
  const Eigen::Vector2d place(520, 90), d(12, -31);
  const internal::LensBend bend(kTruth, place, kSize);
  EXPECT_LT((bend.At(d) - Bend(kTruth, place, d)).norm(), 1e-6);
  const Eigen::Matrix<double, 2, kLensShapes> by_shape = bend.ByShape(d);
  constexpr double kStep = 1e-4;
  for (int i = 0; i < kLensShapes; ++i) {
    const LensShape step = kStep * LensShape::Unit(i);
    const Eigen::Vector2d expected =
        (Bend(kTruth + step, place, d) - Bend(kTruth - step, place, d)) / (2 * kStep);
    EXPECT_LT((by_shape.col(i) - expected).norm(), 1e-3) << i;
  }
}

TEST(LensBend, IsTheSameForEightPlacesAtOnce) {
  const internal::LensBend bend(kTruth, {520, 90}, kSize);
  internal::LensBend::Bent<internal::Eight> eight;
  bend.At<internal::Eight>(internal::Lanes{} + 12.f, internal::Lanes{} - 31.f, &eight);
  const Eigen::Vector2d one = bend.At(Eigen::Vector2d(12, -31));
  const Eigen::Matrix<double, 2, kLensShapes> by_shape = bend.ByShape({12, -31});
  for (int l = 0; l < internal::kLanes; ++l) {
    EXPECT_NEAR(eight.x[l], one.x(), 1e-6);
    EXPECT_NEAR(eight.y[l], one.y(), 1e-6);
    for (int i = 0; i < kLensShapes; ++i) {
      EXPECT_NEAR(eight.by_shape_x[i][l], by_shape(0, i), 1e-5) << i;
      EXPECT_NEAR(eight.by_shape_y[i][l], by_shape(1, i), 1e-5) << i;
    }
  }
}

}  // namespace
}  // namespace plenocal
