// SPDX-License-Identifier: Apache-2.0
#include "calib/space/point_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "calib/base/linear_algebra.h"
#include "calib/camera/rays.h"
#include "calib/space/common_errors.h"
#include "calib/space/point_derivative.h"

namespace plenocal {
namespace {

using Observations = std::span<const SpaceObservation>;

// In the rig's frame.
std::optional<Ray> RayOf(const SpaceRig& rig, const SpaceObservation& seen) {
  const BundleCamera& camera = rig.cameras[seen.camera];
  const std::optional<Ray> ray = Unproject(camera, seen.values.data());
  if (!ray) return std::nullopt;
  const RigidTransform T_rig_camera = camera.T_camera_rig.Inverse();
  return Ray{T_rig_camera * ray->origin, T_rig_camera.R * ray->direction};
}

// The point nearest to the rays, also one at infinity: the sum of |(I - d d') (m + rho (o - p))|^2
// over rays p + l d is least for |m| = 1.
void Start(const std::vector<Ray>& rays, SpacePoint* point) {
  Eigen::Matrix3d by_m = Eigen::Matrix3d::Zero();
  Eigen::Vector3d by_both = Eigen::Vector3d::Zero();
  double by_rho = 0;
  for (const Ray& ray : rays) {
    const Eigen::Matrix3d across =
        Eigen::Matrix3d::Identity() - ray.direction * ray.direction.transpose();
    const Eigen::Vector3d b = across * (point->o - ray.origin);
    by_m += across;
    by_both += b;
    by_rho += b.squaredNorm();
  }
  // rho of the least sum for a given m, and then m.
  Eigen::Matrix3d reduced = by_m;
  if (by_rho > 0) reduced -= by_both * by_both.transpose() / by_rho;
  point->m = DecomposeSymmetric(reduced).vectors.col(0);
  if (point->m.dot(rays[0].direction) < 0) point->m = -point->m;
  point->rho = by_rho > 0 ? -by_both.dot(point->m) / by_rho : 0;
}

// The directions a and b in which m changes.
Eigen::Matrix<double, 3, 2> Across(const Eigen::Vector3d& m) {
  Eigen::Matrix<double, 3, 2> across;
  across.col(0) = m.unitOrthogonal();
  across.col(1) = m.cross(across.col(0));
  return across;
}

// All residuals and derivatives in units of their noise.
struct Whitened {
  Eigen::VectorXd residual;
  Eigen::MatrixXd by_point, by_theta;  // n x 3, n x theta
};

// The point p / h, and the change of (p, h) by each of its three coordinates.
struct Place {
  Eigen::Vector3d p;
  double h;
  Eigen::Matrix<double, 4, 3> by;
};

// Coordinates (a, b, rho).
Place PlaceOf(const SpacePoint& point) {
  Place place{point.rho * point.o + point.m, point.rho, {}};
  place.by << Across(point.m), point.o, Eigen::RowVector3d(0, 0, 1);
  return place;
}

// The root of the inverse covariance of one coordinate: of a camera's observations of a marker,
// whose noise has a part common to all; or of cameras whose noise is correlated.
Eigen::MatrixXd Whitening(const SpaceRig& rig, Observations seen) {
  const auto n = static_cast<Eigen::Index>(seen.size());
  Eigen::MatrixXd covariance(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const SpaceObservation& a = seen[static_cast<size_t>(i)];
    for (Eigen::Index j = 0; j < n; ++j) {
      const SpaceObservation& b = seen[static_cast<size_t>(j)];
      const double common = n > 1 ? rig.fits[a.camera].common_noise : 0;
      covariance(i, j) =
          a.camera == b.camera ? common * common : rig.correlation * a.sigma * b.sigma;
    }
    covariance(i, i) += a.sigma * a.sigma;
  }
  const Eigen::MatrixXd lower = covariance.llt().matrixL();
  return lower.triangularView<Eigen::Lower>().solve(Eigen::MatrixXd::Identity(n, n));
}

// `seen` is in the order of cameras. Nothing outside a model's domain. Without derivatives by theta
// unless `with_theta`.
std::optional<Whitened> Linearise(const SpaceRig& rig,
                                  Observations seen,
                                  const Place& place,
                                  bool with_theta) {
  std::vector<PointDerivative> each(seen.size());
  Eigen::Index rows = 0;
  for (size_t i = 0; i < seen.size(); ++i) {
    if (!Differentiate(rig, seen[i], place.p, place.h, &each[i], with_theta)) return std::nullopt;
    rows += each[i].residual.size();
  }
  const Eigen::Index thetas = with_theta ? rig.Size() : 0;
  Whitened all{Eigen::VectorXd(rows), Eigen::MatrixXd(rows, 3), Eigen::MatrixXd(rows, thetas)};
  Eigen::Index row = 0;
  for (size_t begin = 0, end = 0; begin < seen.size(); begin = end) {
    while (end < seen.size() && (rig.correlation != 0 || seen[end].camera == seen[begin].camera)) {
      ++end;
    }
    const auto n = static_cast<Eigen::Index>(end - begin);
    const Eigen::MatrixXd root = Whitening(rig, seen.subspan(begin, end - begin));
    for (Eigen::Index k = 0; k < each[begin].residual.size(); ++k) {
      Eigen::VectorXd residual(n);
      Eigen::MatrixXd by_point(n, 3), by_theta(n, thetas);
      for (Eigen::Index i = 0; i < n; ++i) {
        const PointDerivative& one = each[begin + static_cast<size_t>(i)];
        residual[i] = one.residual[k];
        by_point.row(i) =
            one.by_point.row(k) * place.by.topRows<3>() + one.by_h[k] * place.by.row(3);
        if (thetas > 0) by_theta.row(i) = one.by_theta.row(k);
      }
      all.residual.segment(row, n) = root * residual;
      all.by_point.middleRows(row, n) = root * by_point;
      if (thetas > 0) all.by_theta.middleRows(row, n) = root * by_theta;
      row += n;
    }
  }
  return all;
}

// Steps of Gauss and Newton, halved where the likelihood does not grow.
std::optional<Whitened> Maximise(const SpaceRig& rig, Observations seen, SpacePoint* point) {
  constexpr int kSteps = 20, kHalvings = 10;
  constexpr double kSmall = 1e-4;  // of a standard error; undistortion is exact to less
  const auto at_point = [&](const SpacePoint& at, bool with_theta) {
    return Linearise(rig, seen, PlaceOf(at), with_theta);
  };
  std::optional<Whitened> at = at_point(*point, false);
  for (int i = 0; at && i < kSteps; ++i) {
    const Eigen::Matrix3d H = at->by_point.transpose() * at->by_point;
    Eigen::Vector3d step =
        SolveSymmetric(H, Eigen::Vector3d(at->by_point.transpose() * at->residual));
    if (!step.allFinite()) return std::nullopt;
    const bool is_last = step.dot(H * step) < kSmall * kSmall;
    const double cost = at->residual.squaredNorm();
    std::optional<Whitened> better;
    for (int k = 0; !better && k < kHalvings; ++k, step /= 2) {
      SpacePoint next = *point;
      const Eigen::Vector3d m = point->m + Across(point->m) * step.head<2>();
      next.m = m.normalized();
      next.rho = (point->rho + step.z()) / m.norm();
      better = at_point(next, false);
      if (better && !(better->residual.squaredNorm() <= cost * (1 + 1e-12))) better.reset();
      if (better) *point = next;
    }
    if (!better && !is_last) return std::nullopt;
    if (better) at = std::move(better);
    if (is_last) break;
  }
  return at ? at_point(*point, true) : std::nullopt;
}

// Takes out of a derivative by theta the rigid motion that the calibration's own points follow.
void HoldHousing(const SpaceRig& rig, const Eigen::Vector3d& X, Eigen::MatrixXd* by_theta) {
  Eigen::Matrix<double, 3, 6> by_motion;
  by_motion << Eigen::Matrix3d::Identity(), -Hat(X);
  *by_theta -= by_motion * rig.follow;
}

// The derivative of X = o + m / rho by (a, b, rho).
Eigen::Matrix3d ByInverseDepth(const SpacePoint& point) {
  Eigen::Matrix3d by;
  by << Across(point.m) / point.rho, -point.m / (point.rho * point.rho);
  return by;
}

}  // namespace

std::optional<NearestPoint> NearestToRays(std::span<const Ray> rays) {
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (const Ray& ray : rays) {
    const Eigen::Matrix3d across =
        Eigen::Matrix3d::Identity() - ray.direction * ray.direction.transpose();
    A += across;
    b += across * ray.origin;
  }
  const NearestPoint point{SolveSymmetric(A, b),
                           DecomposeSymmetric(A).values[0] / static_cast<double>(rays.size())};
  return point.position.allFinite() ? std::optional(point) : std::nullopt;
}

SpacePoint FitPoint(const SpaceRig& rig, std::span<const SpaceObservation> seen, SpaceFrame frame) {
  SpacePoint point;
  point.frame_columns = rig.frame_columns;
  point.observations = static_cast<int>(seen.size());
  const auto without = [&](const char* reason) {
    point.reason = reason;
    return point;
  };
  std::vector<SpaceObservation> ordered(seen.begin(), seen.end());
  std::ranges::stable_sort(ordered, {}, &SpaceObservation::camera);
  std::vector<Ray> rays;
  for (const SpaceObservation& each : ordered) {
    const std::optional<Ray> ray = RayOf(rig, each);
    if (!ray) return without("a place that the camera does not image");
    rays.push_back(*ray);
    point.o += ray->origin / static_cast<double>(seen.size());
  }
  if (rays.size() < 2) return without("one ray");
  Start(rays, &point);
  const std::optional<Whitened> all = Maximise(rig, ordered, &point);
  if (!all) return without("no parallax, or rays that meet nowhere");
  const Eigen::Matrix3d H = all->by_point.transpose() * all->by_point;
  const Eigen::Matrix3d noise =
      SolveSymmetric(Eigen::MatrixXd(H), Eigen::MatrixXd(Eigen::MatrixXd::Identity(3, 3)));
  if (!noise.allFinite() || noise.diagonal().minCoeff() <= 0) return without("no parallax");
  const Eigen::MatrixXd gain = -noise * all->by_point.transpose() * all->by_theta;
  const Eigen::MatrixXd by_root = gain * rig.root;
  const double of_calibration = by_root.cols() > 0 ? by_root.row(2).squaredNorm() : 0;
  point.sigma_rho = std::sqrt(noise(2, 2) + of_calibration);
  if (point.rho > 0) {
    const Eigen::Matrix3d by = ByInverseDepth(point);
    point.position = point.o + point.m / point.rho;
    point.noise = by * noise * by.transpose();
    Eigen::MatrixXd moved = by * gain;
    if (frame == SpaceFrame::kHousing) {
      if (rig.follow.size() == 0) return without("the calibration's own points are not known");
      HoldHousing(rig, point.position, &moved);
    }
    point.shared = moved * rig.root;
  } else {
    point.position.setConstant(std::numeric_limits<double>::infinity());
    point.noise.setConstant(std::numeric_limits<double>::infinity());
    point.shared = Eigen::MatrixXd::Zero(3, rig.root.cols());
  }
  // Q' r with Q across the columns of the derivative by the point.
  const Eigen::Index rows = all->residual.size();
  const Eigen::MatrixXd Q = all->by_point.householderQr().householderQ();
  point.misses = Q.rightCols(rows - 3).transpose() * all->residual;
  point.misses_by_calibration = Q.rightCols(rows - 3).transpose() * all->by_theta * rig.root;
  double square = 0;
  PointDerivative at;
  for (const SpaceObservation& each : ordered) {
    Differentiate(rig, each, point.rho * point.o + point.m, point.rho, &at, false);
    square += at.residual.squaredNorm();
  }
  point.rms = std::sqrt(square / static_cast<double>(seen.size()));
  const RaysTest test = CommonErrors({&point, 1}).Test();
  point.chi_square = test.chi_square;
  point.degrees = test.degrees;
  point.probability = test.probability;
  return point;
}

std::optional<PointError> ErrorAt(const SpaceRig& rig,
                                  std::span<const SpaceObservation> seen,
                                  const Eigen::Vector3d& X,
                                  SpaceFrame frame,
                                  bool z_is_known) {
  Place place{X, 1, {}};
  place.by << Eigen::Matrix3d::Identity(), Eigen::RowVector3d::Zero();
  const std::optional<Whitened> all = Linearise(rig, seen, place, true);
  if (!all) return std::nullopt;
  const Eigen::Index free = z_is_known ? 2 : 3;
  const auto J = all->by_point.leftCols(free);
  const Eigen::MatrixXd noise = SolveSymmetric(Eigen::MatrixXd(J.transpose() * J),
                                               Eigen::MatrixXd::Identity(free, free).eval());
  if (!noise.allFinite() || noise.diagonal().minCoeff() <= 0) return std::nullopt;
  PointError error{Eigen::Matrix3d::Zero(), Eigen::MatrixXd::Zero(3, rig.Size())};
  error.noise.topLeftCorner(free, free) = noise;
  error.by_theta.topRows(free) = -noise * (J.transpose() * all->by_theta);
  if (frame == SpaceFrame::kHousing) HoldHousing(rig, X, &error.by_theta);
  return error;
}

DistanceInterval DistanceOf(const SpacePoint& point, double sigmas) {
  DistanceInterval interval;
  const double reach = sigmas * point.sigma_rho;
  if (point.rho + reach > 0) interval.nearest = 1 / (point.rho + reach);
  if (point.rho > reach) interval.farthest = 1 / (point.rho - reach);
  return interval;
}

}  // namespace plenocal
