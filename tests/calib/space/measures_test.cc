// SPDX-License-Identifier: Apache-2.0
#include "calib/space/measures.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <vector>

#include "tests/calib/random.h"

namespace plenocal {
namespace TEST_FILE {

using Eigen::Vector3d;

// Three columns of shared error, the last one of a frame.
SpacePoint Point(const Vector3d& position, double first) {
  SpacePoint point;
  point.position = position;
  const Vector3d axis(0.3, -0.2 * first, 1);
  point.noise = 1e-6 * (Eigen::Matrix3d::Identity() + 5 * axis * axis.transpose());
  point.shared.resize(3, 3);
  point.shared << 1e-3, 2e-3 * first, 0, 0, -1e-3, 3e-3 * first, 5e-4 * first, 0, 1e-3;
  point.frame_columns = 1;
  return point;
}

// The standard errors of a function of positions, by differences.
void ExpectSigmas(const Measured& measured,
                  const std::vector<SpacePoint>& points,
                  const std::function<double(const std::vector<Vector3d>&)>& function) {
  std::vector<Vector3d> at;
  for (const SpacePoint& point : points) at.push_back(point.position);
  EXPECT_NEAR(measured.value - measured.bias, function(at), 1e-12);
  double noise = 0;
  Eigen::RowVector3d by_root = Eigen::RowVector3d::Zero();
  for (size_t i = 0; i < points.size(); ++i) {
    Eigen::RowVector3d by;
    for (int k = 0; k < 3; ++k) {
      constexpr double kStep = 1e-6;
      std::vector<Vector3d> more = at, less = at;
      more[i][k] += kStep, less[i][k] -= kStep;
      by[k] = (function(more) - function(less)) / (2 * kStep);
    }
    noise += by * points[i].noise * by.transpose();
    by_root += by * points[i].shared;
  }
  EXPECT_NEAR(measured.noise, std::sqrt(noise), 1e-9);
  EXPECT_NEAR(measured.calibration, by_root.head<2>().norm(), 1e-9);
  EXPECT_NEAR(measured.jitter, std::abs(by_root[2]), 1e-9);
  EXPECT_NEAR(measured.Sigma(), std::sqrt(noise + by_root.squaredNorm()), 1e-9);
}

TEST(Measures, LengthsHaveTheirStandardErrors) {
  const std::vector<SpacePoint> points{Point({0.1, 0, 2}, 1), Point({3, 0.4, 6}, -2)};
  Measured length = LengthOf(points[0], points[1]);
  const Eigen::MatrixXd shared = points[0].shared - points[1].shared;
  const Eigen::Matrix3d C = points[0].noise + points[1].noise + shared * shared.transpose();
  const Vector3d u = (points[1].position - points[0].position).normalized();
  EXPECT_NEAR(length.bias, (C.trace() - u.dot(C * u)) / (2 * length.value), 1e-15);
  length.bias = 0;  // is stated, and in the value as it is
  ExpectSigmas(length, points, [](const std::vector<Vector3d>& x) { return (x[0] - x[1]).norm(); });
}

TEST(Measures, AnglesHaveTheirStandardErrors) {
  const std::vector<SpacePoint> points{
      Point({1, 0, 2}, 1), Point({0, 0.2, 2.5}, -1), Point({0.3, 1, 3}, 2)};
  ExpectSigmas(
      AngleOf(points[0], points[1], points[2]), points, [](const std::vector<Vector3d>& x) {
        return std::acos((x[0] - x[1]).normalized().dot((x[2] - x[1]).normalized()));
      });
}

TEST(Measures, AMeanHasTheNoiseOfItsPointsAndTheirSharedError) {
  const SpacePoint a = Point({0, 0, 2}, 1), b = Point({3, 1, 6}, -2);
  const std::vector<const SpacePoint*> points{&a, &b};
  const SpacePoint mean = MeanOf(points);
  EXPECT_LT((mean.position - Vector3d(1.5, 0.5, 4)).norm(), 1e-12);
  EXPECT_LT((mean.noise - (a.noise + b.noise) / 4).norm(), 1e-18);
  EXPECT_LT((mean.shared - (a.shared + b.shared) / 2).norm(), 1e-15);
  EXPECT_EQ(mean.frame_columns, 1);
}

constexpr double kSigma = 1e-3;

// Of points with equal noise in all directions.
MeasuredPlane PlaneThrough(const std::vector<Vector3d>& positions,
                           const Vector3d& shared = Vector3d::Zero()) {
  std::vector<SpacePoint> points;
  for (const Vector3d& position : positions) {
    points.emplace_back().position = position;
    points.back().noise = kSigma * kSigma * Eigen::Matrix3d::Identity();
    points.back().shared = shared;
  }
  std::vector<const SpacePoint*> pointers;
  for (const SpacePoint& point : points) pointers.push_back(&point);
  return PlaneOf(pointers);
}

// The corners of a square lie by turns above and below, its middle in the plane.
TEST(Measures, APlaneHasTheProbabilityOfItsResiduals) {
  const Eigen::Matrix3d R =
      Eigen::AngleAxisd(0.4, Vector3d(1, 2, 0).normalized()).toRotationMatrix();
  for (const double d : {0.5 * kSigma, 2 * kSigma}) {
    std::vector<Vector3d> positions;
    for (const Vector3d& at :
         {Vector3d(1, 1, 2 + d), {-1, 1, 2 - d}, {-1, -1, 2 + d}, {1, -1, 2 - d}, {0, 0, 2}}) {
      positions.push_back(R * at);
    }
    const double chi_square = 4 * d * d / (kSigma * kSigma);
    for (const Vector3d& shared : {Vector3d(0, 0, 0), Vector3d(0.01, -0.02, 0.05)}) {
      const MeasuredPlane plane = PlaneThrough(positions, shared);
      EXPECT_EQ(plane.degrees, 2);
      EXPECT_NEAR(plane.chi_square, chi_square, 1e-4 * chi_square)
          << "a common error is the plane's";
      EXPECT_NEAR(plane.probability, std::exp(-chi_square / 2), 1e-4);
      EXPECT_NEAR(plane.rms, d * std::sqrt(0.8), 1e-6 * d);
      EXPECT_LT((plane.normal + R.col(2)).norm(), 1e-6) << "towards the origin";
      EXPECT_NEAR(plane.offset, -2, 1e-6);
    }
  }
}

TEST(Measures, APlaneIsNearestToThePointsThatAreCertain) {
  testing::Random random(5);
  std::vector<SpacePoint> points(8);
  std::vector<const SpacePoint*> pointers;
  std::vector<double> variances;
  for (SpacePoint& point : points) {
    const double sigma = kSigma * (pointers.size() % 3 == 0 ? 10 : 1);
    variances.push_back(sigma * sigma);
    point.position =
        Vector3d(random.Uniform(-1, 1), random.Uniform(-1, 1), 3) + random.Gaussians<3>(sigma);
    point.noise = variances.back() * Eigen::Matrix3d::Identity();
    point.shared = Vector3d::Zero();
    pointers.push_back(&point);
  }
  const MeasuredPlane plane = PlaneOf(pointers);
  const auto chi_square = [&](const Vector3d& normal, double offset) {
    double sum = 0;
    for (size_t i = 0; i < points.size(); ++i) {
      sum += std::pow(normal.dot(points[i].position) - offset, 2) / variances[i];
    }
    return sum;
  };
  EXPECT_NEAR(chi_square(plane.normal, plane.offset), plane.chi_square, 1e-9 * plane.chi_square);
  for (int i = 0; i < 4; ++i) {
    for (const double step : {-0.1 * kSigma, 0.1 * kSigma}) {
      const Vector3d turned =
          (plane.normal + (i < 3 ? step : 0) * Vector3d::Unit(i % 3)).normalized();
      EXPECT_GE(chi_square(turned, plane.offset + (i == 3 ? step : 0)), plane.chi_square) << i;
    }
  }
}

TEST(Measures, ThreePointsHaveTheirPlaneAndALineHasNone) {
  const MeasuredPlane plane = PlaneThrough({{1, 0, 2}, {0, 1, 2}, {0, 0, 2}});
  EXPECT_EQ(plane.degrees, 0);
  EXPECT_EQ(plane.probability, 1);
  EXPECT_LT((plane.normal - Vector3d(0, 0, -1)).norm(), 1e-9);
  EXPECT_LT(PlaneThrough({{1, 0, 2}, {0, 1, 2}}).degrees, 0);
  EXPECT_LT(PlaneThrough({{1, 0, 2}, {2, 0, 4}, {3, 0, 6}, {4, 0, 8}}).degrees, 0);
}

}  // namespace TEST_FILE
}  // namespace plenocal
