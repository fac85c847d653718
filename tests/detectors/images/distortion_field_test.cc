// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/distortion_field.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <vector>

#include "detectors/tags/distortion_basis.h"

namespace plenocal {
namespace TEST_FILE {

const Eigen::Vector2d kSize(640, 480);
constexpr double kSigma = 2e-4;  // 1/px

/// A radial distortion A_0, A_1, A_2 about an axis that is not in the middle.
constexpr std::array kRadial{-0.21, 0.07, -0.01};
const Eigen::Vector2d kAxis(331, 229);
Eigen::Vector2d Distortion(const Eigen::Vector2d& x) {
  const double radius = kSize.norm() / 2;
  const Eigen::Vector2d q = (x - kAxis) / radius;
  double factor = 0;
  for (std::size_t n = 0; n < kRadial.size(); ++n) {
    factor += kRadial[n] * std::pow(q.squaredNorm(), n + 1);
  }
  return radius * factor * q;
}

/// Curvature of the image of an edge that goes 30 px to either side: its second difference across
/// the edge. A homography keeps straight edges straight.
double Curvature(const Eigen::Vector2d& place, const Eigen::Vector2d& normal) {
  const Eigen::Vector2d half(30 * normal.y(), -30 * normal.x());
  return normal.dot(Distortion(place + half) + Distortion(place - half) - 2 * Distortion(place)) /
         (2 * half.squaredNorm());
}

/// The measurement by such an edge, without noise but with its variance.
DistortionMeasurement MeasureEdge(
    const Eigen::Vector2d& place,
    double angle,
    const std::function<double(Eigen::Vector2d, Eigen::Vector2d)>& curvature_of,
    double sigma) {
  const Eigen::Vector2d normal(std::cos(angle), std::sin(angle));
  const internal::DistortionBasis basis(place, kSize);
  const LocalDistortion row = basis.EdgeCurvature({30 * normal.y(), -30 * normal.x()}, normal);
  const double size = row.norm();
  return {basis.p(), row / size, curvature_of(place, normal) / size, sigma * sigma / (size * size)};
}

/// Of edges all over the image.
std::vector<DistortionMeasurement> Measurements(int count, double sigma, std::mt19937* random) {
  std::uniform_real_distribution<double> uniform(0, 1);
  std::normal_distribution<double> normal;
  std::vector<DistortionMeasurement> measurements;
  for (int i = 0; i < count; ++i) {
    // Arguments of one call would be drawn in an order that depends on the compiler.
    const double y = uniform(*random) * kSize.y(), x = uniform(*random) * kSize.x();
    const Eigen::Vector2d place(x, y);
    measurements.push_back(
        MeasureEdge(place, 2 * std::numbers::pi * uniform(*random), Curvature, sigma));
    measurements.back().value += std::sqrt(measurements.back().variance) * normal(*random);
  }
  return measurements;
}

/// Sigma of what the field has in place of the measured value.
double SigmaOf(const DistortionField& field, const DistortionMeasurement& edge) {
  DistortionSensitivity sensitivity{{{edge.p, field.At(edge.p), {}}}, 0};
  sensitivity.pieces[0].by_distortion << edge.along.transpose(), edge.along.transpose();
  return field.Sigma(sensitivity);
}

TEST(DistortionField, IsEstimatedFromManyUncertainMeasurements) {
  std::mt19937 random(5);
  const DistortionField field(Measurements(20000, kSigma, &random));
  for (const Eigen::Vector2d& place : {Eigen::Vector2d(60, 50), {320, 400}, {560, 300}}) {
    for (const double angle : {0.0, 0.8, 1.6}) {
      const DistortionMeasurement edge = MeasureEdge(place, angle, Curvature, kSigma);
      const double sigma = SigmaOf(field, edge);
      EXPECT_LT(sigma, 0.05 * std::sqrt(edge.variance));
      EXPECT_NEAR(edge.along.dot(field.At(edge.p)), edge.value, 3 * sigma);
    }
  }
}

TEST(DistortionField, FindsTheAxis) {
  std::mt19937 random(5);
  const DistortionField field(Measurements(4000, 0.01 * kSigma, &random));
  EXPECT_LT((field.axis() - internal::DistortionBasis(kAxis, kSize).p()).norm() * kSize.norm() / 2,
            2);
}

TEST(DistortionField, GivesDisplacementsThatEdgesDoNotShow) {
  std::mt19937 random(5);
  const DistortionField field(Measurements(4000, 0.01 * kSigma, &random));
  const Eigen::Vector2d place(520, 90);
  const internal::DistortionBasis basis(place, kSize);
  const LocalDistortion distortion = field.At(basis.p());
  // Per coordinate of 7 x 7 points: what a homography does to first order, and two vectors.
  constexpr int kSide = 7;
  Eigen::MatrixXd homography(2 * kSide * kSide, 8);
  Eigen::MatrixX2d displacement(2 * kSide * kSide, 2);  // true, and what the field leaves of it
  int row = 0;
  for (int i = 0; i < kSide; ++i) {
    for (int j = 0; j < kSide; ++j, row += 2) {
      const Eigen::Vector2d d(8 * (i - kSide / 2), 8 * (j - kSide / 2));
      homography.middleRows<2>(row) << 1, 0, d.x(), 0, d.y(), 0, d.x() * d.x(), d.x() * d.y(),  //
          0, 1, 0, d.x(), 0, d.y(), d.x() * d.y(), d.y() * d.y();
      displacement.block<2, 1>(row, 0) = Distortion(place + d);
      displacement.block<2, 1>(row, 1) = Distortion(place + d) - basis.At(d) * distortion;
    }
  }
  const Eigen::MatrixX2d left =
      displacement - homography * homography.colPivHouseholderQr().solve(displacement).eval();
  EXPECT_LT(left.col(1).norm(), 0.02 * left.col(0).norm());
}

// What edges do not show follows from the field: the terms of third order of a radial distortion
// A |q|^2n q, by differences. A homography's part of them is as small as the distortion's slope.
TEST(DistortionField, HasTheThirdOrderOfEachRadialTerm) {
  constexpr double kReach = 25;  // px
  const double radius = kSize.norm() / 2;
  for (const int n : {1, 2, 3, 4, 5}) {
    const auto displacement = [&](const Eigen::Vector2d& x) -> Eigen::Vector2d {
      const Eigen::Vector2d q = (x - kAxis) / radius;
      return radius * 0.05 * std::pow(q.squaredNorm(), n) * q;
    };
    const auto curvature = [&](const Eigen::Vector2d& place, const Eigen::Vector2d& normal) {
      const Eigen::Vector2d half(30 * normal.y(), -30 * normal.x());
      return normal.dot(displacement(place + half) + displacement(place - half) -
                        2 * displacement(place)) /
             (2 * half.squaredNorm());
    };
    std::mt19937 random(5);
    std::uniform_real_distribution<double> uniform(0, 1);
    std::vector<DistortionMeasurement> measurements;
    for (int i = 0; i < 600; ++i) {
      const double y = uniform(random) * kSize.y(), x = uniform(random) * kSize.x();
      const double angle = 2 * std::numbers::pi * uniform(random);
      measurements.push_back(MeasureEdge({x, y}, angle, curvature, 1e-6));
    }
    const DistortionField field(measurements);
    for (const Eigen::Vector2d& place :
         {Eigen::Vector2d(120, 90), {500, 400}, {330, 60}, {560, 230}}) {
      const internal::DistortionBasis basis(place, kSize);
      const LocalDistortion local = field.At(basis.p());
      double errors = 0, lengths = 0;
      for (int k = 0; k < 12; ++k) {
        const double angle = k * std::numbers::pi / 6;
        const Eigen::Vector2d one(std::cos(angle), std::sin(angle)), d = kReach * one;
        const Eigen::Vector2d odd = (displacement(place + d) - displacement(place - d)) / 2,
                              linear = kReach / 2 *
                                       (displacement(place + one) - displacement(place - one));
        const Eigen::Vector2d found = (basis.At(d) - basis.At(-d)) * local / 2;
        errors += (found - (odd - linear)).squaredNorm();
        lengths += (odd - linear).squaredNorm();
      }
      EXPECT_LT(std::sqrt(errors / lengths), 0.1) << n << " at " << place.transpose();
    }
  }
}

TEST(DistortionField, StatesItsUncertainty) {
  double chi2 = 0;
  int n = 0;
  for (unsigned seed = 0; seed < 100; ++seed) {
    std::mt19937 random(seed);
    const DistortionField field(Measurements(4000, kSigma, &random));
    for (const Eigen::Vector2d& place : {Eigen::Vector2d(100, 100), Eigen::Vector2d(500, 300)}) {
      for (const double angle : {0.0, std::numbers::pi / 2}) {
        const DistortionMeasurement edge = MeasureEdge(place, angle, Curvature, kSigma);
        const double error = edge.along.dot(field.At(edge.p)) - edge.value;
        const double sigma = SigmaOf(field, edge);
        chi2 += error * error / (sigma * sigma);
        ++n;
      }
    }
  }
  // Empirical Bayes is a little too sure of coefficients that it takes for zero.
  EXPECT_GT(chi2 / n, 0.7);
  EXPECT_LT(chi2 / n, 1.5);
}

TEST(DistortionField, StatesWhatHigherOrdersMayDisplace) {
  std::mt19937 random(3);
  const DistortionField field(Measurements(4000, kSigma, &random));
  const internal::DistortionBasis middle({400, 300}, kSize);
  const auto displaced_at = [&](const Eigen::Vector2d& corner) {
    const DistortionSensitivity sensitivity{
        {{middle.p(), field.At(middle.p()), middle.At(corner - Eigen::Vector2d(400, 300))}}, 0};
    return field.HigherOrders(sensitivity, PlaceOfPixel(corner, kSize)).norm();
  };
  // Of a small tag nothing, of one as large as a third of the image more than its noise.
  EXPECT_LT(displaced_at({410, 310}), 0.003);
  EXPECT_GT(displaced_at({480, 380}), 0.05);
}

TEST(DistortionField, IsZeroWithoutMeasurementsAndSmallForFew) {
  EXPECT_EQ(DistortionField({}).At({0.5, 0.2}), LocalDistortion::Zero());
  std::mt19937 random(7);
  const DistortionField field(Measurements(4, kSigma, &random));
  const DistortionMeasurement edge =
      MeasureEdge({600, 40}, std::numbers::pi / 2, Curvature, kSigma);
  EXPECT_LT(std::abs(edge.along.dot(field.At(edge.p))), 3 * std::sqrt(edge.variance));
}

/// A fisheye whose rays are theta = r / f about the axis: px on the plane that
/// touches the sphere of rays where `place` is seen.
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

/// Curvature of the image of a straight edge, px per square of d.
double FisheyeCurvature(const Eigen::Vector2d& place, const Eigen::Vector2d& normal) {
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

TEST(DistortionField, DescribesAFisheye) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<DistortionMeasurement> measurements;
  for (int i = 0; i < 2000; ++i) {
    const double y = uniform(random) * kSize.y(), x = uniform(random) * kSize.x();
    const Eigen::Vector2d place(x, y);
    measurements.push_back(
        MeasureEdge(place, 2 * std::numbers::pi * uniform(random), FisheyeCurvature, 1e-7));
  }
  const DistortionField field(measurements);
  double square = 0, rest = 0;
  for (const DistortionMeasurement& measurement : measurements) {
    // Each edge by its curvature, which has the variance of all.
    const double weight = 1 / measurement.variance;
    const double left = measurement.value - measurement.along.dot(field.At(measurement.p));
    square += weight * measurement.value * measurement.value;
    rest += weight * left * left;
  }
  EXPECT_LT(std::sqrt(rest / square), 0.02);
}

TEST(DistortionBasis, IsTheSameForEightPlacesAtOnce) {
  const internal::DistortionBasis basis({520, 90}, kSize);
  internal::DistortionBasis::Displacements<internal::Eight> eight;
  basis.At<internal::Eight>(internal::Lanes{} + 12.f, internal::Lanes{} - 31.f, &eight);
  const Eigen::Matrix<double, 2, kDistortionTerms> one = basis.At({12, -31});
  for (int l = 0; l < internal::kLanes; ++l) {
    for (int i = 0; i < kDistortionTerms; ++i) {
      EXPECT_NEAR(eight.x[i][l], one(0, i), 1e-5) << i;
      EXPECT_NEAR(eight.y[i][l], one(1, i), 1e-5) << i;
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
