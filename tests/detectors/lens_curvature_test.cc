// SPDX-License-Identifier: Apache-2.0
#include "detectors/lens_curvature.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

namespace plenocal {
namespace {

const Eigen::Vector2d kSize(640, 480), kAxis(330, 230);
constexpr double kSigma = 2e-4;  // 1/px

/// Of a lens with third-order radial distortion.
Eigen::Vector2d Curvature(const Eigen::Vector2d& place) { return -1.2e-6 * (place - kAxis); }

std::vector<BentEdge> Edges(int count, std::mt19937* random) {
  std::uniform_real_distribution<double> uniform(0, 1);
  std::normal_distribution<double> normal;
  std::vector<BentEdge> edges;
  for (int i = 0; i < count; ++i) {
    BentEdge edge;
    edge.place = {uniform(*random) * kSize.x(), uniform(*random) * kSize.y()};
    const double angle = 2 * std::numbers::pi * uniform(*random);
    edge.normal = {std::cos(angle), std::sin(angle)};
    edge.bend = edge.normal.dot(Curvature(edge.place)) + kSigma * normal(*random);
    edge.variance = kSigma * kSigma;
    edges.push_back(edge);
  }
  return edges;
}

TEST(LensCurvature, IsLearnedFromManyUncertainEdges) {
  std::mt19937 random(5);
  const LensCurvature lens(Edges(2000, &random), kSize);
  for (const double x : {50., 320., 600.}) {
    for (const double y : {40., 240., 430.}) {
      const Eigen::Vector2d place(x, y), error = lens.At(place) - Curvature(place);
      EXPECT_LT(error.norm(), 5e-5) << place.transpose();  // at the corners c is 4.4e-4
      // Two components within three sigma each.
      EXPECT_LT(error.norm(), 4.3 * std::sqrt(lens.Variance(place, Eigen::Vector2d::UnitX())));
    }
  }
}

TEST(LensCurvature, SaysHowUncertainItIs) {
  double chi2 = 0;
  int n = 0;
  for (unsigned seed = 0; seed < 100; ++seed) {
    std::mt19937 random(seed);
    const LensCurvature lens(Edges(200, &random), kSize);
    for (const Eigen::Vector2d& place : {Eigen::Vector2d(100, 100), Eigen::Vector2d(500, 300)}) {
      for (const Eigen::Vector2d& normal : {Eigen::Vector2d(1, 0), Eigen::Vector2d(0, 1)}) {
        const double error = normal.dot(lens.At(place) - Curvature(place));
        chi2 += error * error / lens.Variance(place, normal);
        ++n;
      }
    }
  }
  EXPECT_GT(chi2 / n, 0.7);
  EXPECT_LT(chi2 / n, 1.3);
}

TEST(LensCurvature, IsNoneWithoutEdgesAndSmallForFew) {
  const Eigen::Vector2d place(600, 40);
  EXPECT_EQ(LensCurvature({}, kSize).At(place), Eigen::Vector2d(0, 0));
  std::mt19937 random(7);
  const auto edges = Edges(4, &random);
  EXPECT_LT(LensCurvature(edges, kSize).At(place).norm(), 3 * kSigma);
}

}  // namespace
}  // namespace plenocal
