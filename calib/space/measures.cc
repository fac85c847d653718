// SPDX-License-Identifier: Apache-2.0
#include "calib/space/measures.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cmath>
#include <utility>
#include <vector>

#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

using Part = std::pair<const SpacePoint*, Eigen::Vector3d>;  // a point and the derivative by it

// The standard errors of a number by its derivatives.
void SetSigmas(const std::vector<Part>& parts, Measured* measured) {
  double noise = 0;
  Eigen::RowVectorXd by_root = Eigen::RowVectorXd::Zero(parts[0].first->shared.cols());
  for (const auto& [point, by] : parts) {
    noise += by.dot(point->noise * by);
    by_root += by.transpose() * point->shared;
  }
  const Eigen::Index own_columns = parts[0].first->frame_columns;
  measured->noise = std::sqrt(noise);
  measured->calibration = by_root.head(by_root.size() - own_columns).norm();
  measured->jitter = by_root.tail(own_columns).norm();
}

}  // namespace

double Measured::Sigma() const { return std::hypot(noise, calibration, jitter); }

Measured LengthOf(const SpacePoint& a, const SpacePoint& b) {
  const Eigen::Vector3d difference = a.position - b.position;
  Measured length{.value = difference.norm()};
  const Eigen::Vector3d u = difference / length.value;
  SetSigmas({{&a, u}, {&b, -u}}, &length);
  const Eigen::MatrixXd shared = a.shared - b.shared;
  const Eigen::Matrix3d covariance = a.noise + b.noise + shared * shared.transpose();
  length.bias = (covariance.trace() - u.dot(covariance * u)) / (2 * length.value);
  return length;
}

Measured AngleOf(const SpacePoint& a, const SpacePoint& b, const SpacePoint& c) {
  const Eigen::Vector3d p = a.position - b.position, q = c.position - b.position;
  const Eigen::Vector3d p1 = p.normalized(), q1 = q.normalized();
  const double sine = p1.cross(q1).norm(), cosine = p1.dot(q1);
  Measured angle{.value = std::atan2(sine, cosine)};
  const Eigen::Vector3d by_a = (cosine * p1 - q1) / (p.norm() * sine);
  const Eigen::Vector3d by_c = (cosine * q1 - p1) / (q.norm() * sine);
  SetSigmas({{&a, by_a}, {&b, -by_a - by_c}, {&c, by_c}}, &angle);
  return angle;
}

SpacePoint MeanOf(std::span<const SpacePoint* const> points) {
  const auto n = static_cast<double>(points.size());
  SpacePoint mean;
  mean.noise.setZero();
  mean.frame_columns = points[0]->frame_columns;
  mean.shared = Eigen::MatrixXd::Zero(3, points[0]->shared.cols());
  for (const SpacePoint* point : points) {
    mean.position += point->position / n;
    mean.noise += point->noise / (n * n);
    mean.shared += point->shared / n;
  }
  return mean;
}

MeasuredPlane PlaneOf(std::span<const SpacePoint* const> points) {
  MeasuredPlane plane{.degrees = static_cast<int>(points.size()) - 3};
  if (plane.degrees < 0) return plane;
  const auto n = static_cast<Eigen::Index>(points.size());
  Eigen::Matrix<double, Eigen::Dynamic, 3> X(n, 3);
  for (Eigen::Index i = 0; i < n; ++i) X.row(i) = points[static_cast<size_t>(i)]->position;
  const Eigen::RowVector3d middle = X.colwise().mean();
  const Eigen::Matrix<double, Eigen::Dynamic, 3> about = X.rowwise() - middle;
  const SymmetricEigen3 spread = DecomposeSymmetric(Eigen::Matrix3d(about.transpose() * about));
  if (!(spread.values[1] > 1e-12 * spread.values[2])) {
    plane.degrees = -1;
    return plane;
  }
  plane.normal = spread.vectors.col(0);
  plane.offset = middle.dot(plane.normal);
  // Steps in two directions of the normal and the offset; the covariance of the distances follows.
  constexpr int kSteps = 5;
  for (int step = 0; step <= kSteps; ++step) {
    Eigen::MatrixXd covariance(n, n);
    Eigen::MatrixXd by_root(n, points[0]->shared.cols());
    Eigen::VectorXd distance(n);
    Eigen::Matrix<double, Eigen::Dynamic, 3> by(n, 3);
    const Eigen::Vector3d e1 = plane.normal.unitOrthogonal(), e2 = plane.normal.cross(e1);
    for (Eigen::Index i = 0; i < n; ++i) {
      const SpacePoint& point = *points[static_cast<size_t>(i)];
      distance[i] = plane.normal.dot(point.position) - plane.offset;
      by.row(i) << e1.dot(point.position), e2.dot(point.position), -1;
      by_root.row(i) = plane.normal.transpose() * point.shared;
    }
    covariance = by_root * by_root.transpose();
    for (Eigen::Index i = 0; i < n; ++i) {
      covariance(i, i) += plane.normal.dot(points[static_cast<size_t>(i)]->noise * plane.normal);
    }
    const Eigen::LLT<Eigen::MatrixXd> root(covariance);
    const Eigen::MatrixXd J = root.matrixL().solve(by);
    const Eigen::VectorXd r = root.matrixL().solve(distance);
    plane.chi_square = r.squaredNorm();
    plane.rms = std::sqrt(distance.squaredNorm() / static_cast<double>(n));
    if (step == kSteps) break;
    const Eigen::Vector3d change = LeastSquares(Eigen::MatrixXd(J), Eigen::VectorXd(-r));
    const Eigen::Vector3d normal = plane.normal + change[0] * e1 + change[1] * e2;
    plane.offset = (plane.offset + change[2]) / normal.norm();
    plane.normal = normal.normalized();
  }
  if (plane.offset > 0) {
    plane.normal = -plane.normal;
    plane.offset = -plane.offset;
  }
  plane.probability = plane.degrees > 0 ? ChiSquareTail(plane.degrees, plane.chi_square) : 1;
  return plane;
}

}  // namespace plenocal
