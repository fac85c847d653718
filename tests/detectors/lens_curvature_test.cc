// SPDX-License-Identifier: Apache-2.0
#include "detectors/lens_curvature.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "detectors/lens_bend.h"

namespace plenocal {
namespace {

const Eigen::Vector2d kSize(640, 480);
constexpr double kSigma = 2e-4;  // 1/px

const LensShape kTruth{0.01, -0.02, -0.21, 0.07, -0.01, 0.01, 0, 0.03, 0};

/// How an edge 60 px long is bent.
LensShape Edge(const Eigen::Vector2d& place, const Eigen::Vector2d& normal) {
  return internal::LensBend(place, kSize).OfEdge({30 * normal.y(), -30 * normal.x()}, normal);
}

/// Of such edges.
std::vector<LensReading> Readings(int count, std::mt19937* random) {
  std::uniform_real_distribution<double> uniform(0, 1);
  std::normal_distribution<double> normal;
  std::vector<LensReading> readings;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector2d place(uniform(*random) * kSize.x(), uniform(*random) * kSize.y());
    const double angle = 2 * std::numbers::pi * uniform(*random);
    const Eigen::Vector2d across(std::cos(angle), std::sin(angle));
    const LensShape row = Edge(place, across);
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
        const LensShape row = Edge(place, normal);
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
  const LensShape row = Edge({600, 40}, Eigen::Vector2d::UnitY());
  EXPECT_LT(std::abs(row.dot(LensCurvature(readings).shape())), 3 * kSigma);
}

/// The radial distortion of a shape, px.
Eigen::Vector2d Distortion(const LensShape& shape, const Eigen::Vector2d& x) {
  const double radius = kSize.norm() / 2;
  const Eigen::Vector2d p = (x - (kSize - Eigen::Vector2d::Ones()) / 2) / radius;
  const double s = p.squaredNorm();
  Eigen::Vector2d shift = shape.head<2>() * s;
  for (int n = 1; n <= kRadialOrders; ++n) shift += shape[n + 1] * std::pow(s, n) * p;
  return radius * shift;
}

TEST(LensBend, IsWhatAWeakDistortionDoesBeyondItsLinearPart) {
  const Eigen::Vector2d place(520, 90), d(12, -31);
  LensShape weak = kTruth;
  weak.tail<kOtherOrders>().setZero();
  Eigen::Vector2d expected = Distortion(weak, place + d) - Distortion(weak, place);
  constexpr double kStep = 1e-3;
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector2d step = kStep * Eigen::Vector2d::Unit(i);
    expected -=
        d[i] / (2 * kStep) * (Distortion(weak, place + step) - Distortion(weak, place - step));
  }
  EXPECT_LT((internal::LensBend(place, kSize).At(d) * weak - expected).norm(), 1e-6);
}

/// A fisheye whose rays are theta = r / f about the axis through `kAxis`: px on the plane that
/// touches the sphere of rays where `place` is seen.
const Eigen::Vector2d kAxis(322, 236);
Eigen::Vector2d OnTangentPlane(const Eigen::Vector2d& place, const Eigen::Vector2d& x) {
  constexpr double kF = 250;
  const auto ray = [](const Eigen::Vector2d& at) {
    const Eigen::Vector2d from = at - kAxis;
    const double theta = from.norm() / kF;
    return Eigen::Vector3d(std::sin(theta) * from.x() / from.norm(),
                           std::sin(theta) * from.y() / from.norm(),
                           std::cos(theta));
  };
  const Eigen::Quaterniond upright =
      Eigen::Quaterniond::FromTwoVectors(ray(place), Eigen::Vector3d::UnitZ());
  return kF * (upright * ray(x)).hnormalized();
}

/// What of the image of a straight edge is bent, px per square of d.
double FisheyeBend(const Eigen::Vector2d& place, const Eigen::Vector2d& normal) {
  // On the plane an edge through the place in the direction that `normal` is across of.
  constexpr double kStep = 0.5;
  const Eigen::Vector2d along(normal.y(), -normal.x());
  const Eigen::Vector2d edge = OnTangentPlane(place, place + 1e-3 * along).normalized();
  const auto across = [&](const Eigen::Vector2d& x) {
    const Eigen::Vector2d y = OnTangentPlane(place, x);
    return y.x() * edge.y() - y.y() * edge.x();
  };
  double sum = 0;
  for (const double d : {-kStep, kStep}) {
    // Newton's steps to where the edge is at a distance d along the tangent.
    double offset = 0;
    for (int i = 0; i < 10; ++i) {
      const auto at = [&](double t) { return across(place + d * along + t * normal); };
      offset -= at(offset) * 2e-4 / (at(offset + 1e-4) - at(offset - 1e-4));
    }
    sum += offset;
  }
  return sum / (2 * kStep * kStep);
}

TEST(LensCurvature, DescribesAFisheye) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<LensReading> readings;
  std::vector<double> bends;
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector2d place(uniform(random) * kSize.x(), uniform(random) * kSize.y());
    const double angle = 2 * std::numbers::pi * uniform(random);
    const Eigen::Vector2d normal(std::cos(angle), std::sin(angle));
    const LensShape row = Edge(place, normal);
    const double size = row.norm(), bend = FisheyeBend(place, normal);
    readings.push_back({row / size, bend / size, 1e-14 / (size * size)});
    bends.push_back(bend);
  }
  const LensCurvature lens(readings);
  double square = 0, rest = 0;
  for (std::size_t i = 0; i < bends.size(); ++i) {
    const double known = readings[i].along.dot(lens.shape()) / readings[i].value;
    square += bends[i] * bends[i];
    rest += bends[i] * bends[i] * (1 - known) * (1 - known);
  }
  EXPECT_LT(std::sqrt(rest / square), 0.02);
}

TEST(LensBend, IsTheSameForEightPlacesAtOnce) {
  const internal::LensBend bend({520, 90}, kSize);
  internal::LensBend::Shifts<internal::Eight> eight;
  bend.At<internal::Eight>(internal::Lanes{} + 12.f, internal::Lanes{} - 31.f, &eight);
  const Eigen::Matrix<double, 2, kLensShapes> one = bend.At({12, -31});
  for (int l = 0; l < internal::kLanes; ++l) {
    for (int i = 0; i < kLensShapes; ++i) {
      EXPECT_NEAR(eight.x[i][l], one(0, i), 1e-5) << i;
      EXPECT_NEAR(eight.y[i][l], one(1, i), 1e-5) << i;
    }
  }
}

}  // namespace
}  // namespace plenocal
