// SPDX-License-Identifier: Apache-2.0
#include "calib/camera/resection.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include "calib/base/linear_algebra.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

// Point sets whose thickness is below this part of their width are treated as planes (too): the
// direct linear transform of such a set is badly conditioned.
constexpr double kPlaneThickness = 0.05;
// Ratio of width to length under which points count as lying on a line.
constexpr double kLineWidth = 1e-4;

struct Spread {
  Eigen::Vector3d centre;
  Eigen::Matrix3d axes;    // columns by falling extent, right-handed
  Eigen::Vector3d extent;  // root mean square along each axis
};

Spread SpreadOf(std::span<const Eigen::Vector3d> points) {
  Spread spread;
  spread.centre.setZero();
  for (const auto& p : points) spread.centre += p;
  spread.centre /= static_cast<double>(points.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const auto& p : points) {
    scatter += (p - spread.centre) * (p - spread.centre).transpose();
  }
  const SymmetricEigen3 eigen =
      DecomposeSymmetric(Eigen::Matrix3d(scatter / static_cast<double>(points.size())));
  spread.axes = eigen.vectors.rowwise().reverse();
  if (spread.axes.determinant() < 0) spread.axes.col(2) *= -1;
  spread.extent = eigen.values.reverse().cwiseMax(0).cwiseSqrt();
  return spread;
}

// Two unit vectors orthogonal to d and to each other, as rows.
Eigen::Matrix<double, 2, 3> Tangent(const Eigen::Vector3d& d) {
  Eigen::Matrix<double, 2, 3> basis;
  basis.row(0) = d.unitOrthogonal();
  basis.row(1) = d.cross(basis.row(0).transpose());
  return basis;
}

// Smallest right singular vector of the system tangent(d_i) * M * q_i = 0 with q of `columns` rows;
// M is returned 3 x columns.
Eigen::MatrixXd SolveHomogeneous(std::span<const Ray> rays, const Eigen::MatrixXd& q) {
  const Eigen::Index columns = q.rows();
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(3 * columns, 3 * columns);
  Eigen::MatrixXd rows(2, 3 * columns);
  for (size_t i = 0; i < rays.size(); ++i) {
    const auto basis = Tangent(rays[i].direction);
    const auto n = static_cast<Eigen::Index>(i);
    for (Eigen::Index c = 0; c < columns; ++c) rows.middleCols<3>(3 * c) = basis * q(c, n);
    normal += rows.transpose() * rows;
  }
  const Eigen::VectorXd m = DecomposeSymmetric(normal).vectors.col(0);
  return Eigen::Map<const Eigen::MatrixXd>(m.data(), 3, columns);
}

// The sign of the homogeneous solution that puts more points in front of their rays.
double FrontSign(std::span<const Ray> rays, const Eigen::MatrixXd& M, const Eigen::MatrixXd& q) {
  double sum = 0;
  for (size_t i = 0; i < rays.size(); ++i) {
    const Eigen::Vector3d p = M * q.col(static_cast<Eigen::Index>(i));
    sum += std::copysign(1.0, rays[i].direction.dot(p));
  }
  return sum < 0 ? -1 : 1;
}

// Poses of the normalised point set (centred, principal axes, unit extent).
RigidTransform PlanarPose(std::span<const Ray> rays, const Eigen::Matrix3Xd& points) {
  Eigen::MatrixXd q(3, points.cols());
  q.topRows<2>() = points.topRows<2>();
  q.row(2).setOnes();
  Eigen::MatrixXd H = SolveHomogeneous(rays, q);
  H *= FrontSign(rays, H, q) / std::sqrt(H.col(0).norm() * H.col(1).norm());
  Eigen::Matrix3d M;
  M.col(0) = H.col(0);
  M.col(1) = H.col(1);
  M.col(2) = Eigen::Vector3d(H.col(0)).cross(Eigen::Vector3d(H.col(1)));
  return {NearestRotation(M), H.col(2)};
}

RigidTransform SpatialPose(std::span<const Ray> rays, const Eigen::Matrix3Xd& points) {
  Eigen::MatrixXd q(4, points.cols());
  q.topRows<3>() = points;
  q.row(3).setOnes();
  Eigen::MatrixXd P = SolveHomogeneous(rays, q);
  const double sign = std::copysign(1.0, Eigen::Matrix3d(P.leftCols<3>()).determinant());
  const double scale = std::cbrt(std::abs(Eigen::Matrix3d(P.leftCols<3>()).determinant()));
  P *= sign / std::max(scale, std::numeric_limits<double>::min());
  return {NearestRotation(P.leftCols<3>()), P.col(3)};
}

// The pose of the same plane tilted the other way about its line of sight.
RigidTransform MirroredTilt(const RigidTransform& T) {
  const Eigen::Vector3d sight = T.t.normalized();
  const Eigen::Vector3d normal = T.R.col(2);
  const Eigen::Vector3d mirrored = 2 * sight.dot(normal) * sight - normal;
  return {RotationBetween(normal, mirrored) * T.R, T.t};
}

double RootMeanSquare(std::span<const double> values) {
  double sum = 0;
  for (const double value : values) sum += value * value;
  return std::sqrt(sum / static_cast<double>(values.size()));
}

// Root mean square angle of the rays about their mean direction.
double AngularSpan(std::span<const Ray> rays) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Ray& ray : rays) mean += ray.direction;
  std::vector<double> angles;
  for (const Ray& ray : rays) {
    angles.push_back(std::atan2(ray.direction.cross(mean).norm(), ray.direction.dot(mean)));
  }
  return RootMeanSquare(angles);
}

struct Candidate {
  RigidTransform T;
  // Statistics of the angles between rays and points, rad; `best_part` is the rms of the smallest
  // three quarters.
  double median = 0, largest = 0, rms = 0, best_part = 0;
};

// The sines of the angles between rays and points as residuals, two a point.
class AngleProblem {
 public:
  AngleProblem(std::span<const Ray> rays, const Eigen::Matrix3Xd& points)
      : rays_(rays), points_(points) {
    bases_.reserve(rays.size());
    for (const Ray& ray : rays) bases_.push_back(Tangent(ray.direction));
  }

  // False where a point lies in a ray's origin.
  bool Residuals(const RigidTransform& T, Eigen::Matrix2Xd* r) const {
    r->resize(2, Count());
    for (Eigen::Index i = 0; i < Count(); ++i) {
      const Ray& ray = rays_[static_cast<size_t>(i)];
      const Eigen::Vector3d p = T * Eigen::Vector3d(points_.col(i)) - ray.origin;
      const double distance = p.norm();
      if (!(distance > 0)) return false;
      const Eigen::Vector3d u = p / distance;
      const Eigen::Vector2d tangential = bases_[static_cast<size_t>(i)] * u;
      // Behind the ray the sine shrinks again; continue it so that the error keeps growing.
      const double forward = ray.direction.dot(u);
      r->col(i) = forward >= 0 ? tangential : Eigen::Vector2d(tangential * (1 - 4 * forward));
    }
    return true;
  }

  // Normal equations H delta = -g in the chart of T, with Cauchy's weights.
  struct Equations {
    Matrix6d H = Matrix6d::Zero();
    Vector6d g = Vector6d::Zero();
  };
  [[nodiscard]] Equations Linearise(const RigidTransform& T,
                                    const Eigen::Matrix2Xd& r,
                                    double width) const {
    Equations equations;
    for (Eigen::Index i = 0; i < Count(); ++i) {
      const auto k = static_cast<size_t>(i);
      const Eigen::Vector3d rotated = T.R * points_.col(i);
      const Eigen::Vector3d p = rotated + T.t - rays_[k].origin;
      const double inverse = 1 / p.norm();
      const Eigen::Vector3d u = p * inverse;
      // One column a row of the derivatives: b' (I - u u') / |p| by the point, and by a rotation of
      // `rotated` before it.
      Eigen::Matrix<double, 6, 2> J;
      for (Eigen::Index row = 0; row < 2; ++row) {
        const Eigen::Vector3d basis = bases_[k].row(row);
        const Eigen::Vector3d J_p = (basis - basis.dot(u) * u) * inverse;
        J.col(row) << J_p, rotated.cross(J_p);
      }
      const double weight = CauchyWeight(r.col(i).squaredNorm() / (width * width));
      equations.H.noalias() += (weight * J).lazyProduct(J.transpose());
      equations.g.noalias() += J.lazyProduct(weight * r.col(i));
    }
    return equations;
  }

  // The pose with its angles; nothing when most points are behind their rays.
  [[nodiscard]] std::optional<Candidate> Judge(const RigidTransform& T) const {
    std::vector<double> angles;
    double front = 0;
    for (Eigen::Index i = 0; i < Count(); ++i) {
      const auto k = static_cast<size_t>(i);
      const Eigen::Vector3d p = T * Eigen::Vector3d(points_.col(i)) - rays_[k].origin;
      angles.push_back(std::atan2((bases_[k] * p).norm(), rays_[k].direction.dot(p)));
      front += rays_[k].direction.dot(p) > 0 ? 1 : 0;
    }
    if (2 * front < static_cast<double>(Count())) return std::nullopt;
    std::sort(angles.begin(), angles.end());
    return Candidate{
        .T = T,
        .median = angles[angles.size() / 2],
        .largest = angles.back(),
        .rms = RootMeanSquare(angles),
        .best_part = RootMeanSquare(std::span(angles).first(angles.size() - angles.size() / 4))};
  }

 private:
  [[nodiscard]] Eigen::Index Count() const { return static_cast<Eigen::Index>(rays_.size()); }

  std::span<const Ray> rays_;
  const Eigen::Matrix3Xd& points_;
  std::vector<Eigen::Matrix<double, 2, 3>> bases_;
};

// Width of Cauchy's weight: three median residuals.
double RobustWidth(const Eigen::Matrix2Xd& r) {
  std::vector<double> norms(static_cast<size_t>(r.cols()));
  for (Eigen::Index i = 0; i < r.cols(); ++i) norms[static_cast<size_t>(i)] = r.col(i).norm();
  return std::max(3 * Median(norms), 1e-12);
}

// Levenberg-Marquardt on the angles between rays and points, reweighted by Cauchy's function with
// a width from the median residual, so that a misread marker does not pull the pose.
std::optional<Candidate> Refine(std::span<const Ray> rays,
                                const Eigen::Matrix3Xd& points,
                                RigidTransform T) {
  constexpr int kMaxIterations = 50, kMaxAttempts = 10;
  // Parts of the target's extent, and rad; far below what any image can determine. The bundle
  // adjustment does the rest.
  constexpr double kSmallStep = 1e-4;
  constexpr double kFirstDamping = 1e-3, kLeastDamping = 1e-12;
  const AngleProblem problem(rays, points);
  Eigen::Matrix2Xd r;
  if (!problem.Residuals(T, &r)) return std::nullopt;
  double damping = kFirstDamping;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const double width = RobustWidth(r);
    const auto cost = [&](const Eigen::Matrix2Xd& residuals) {
      return (residuals.colwise().squaredNorm().array() / (width * width)).log1p().sum();
    };
    const AngleProblem::Equations equations = problem.Linearise(T, r, width);
    const double before = cost(r);
    bool improved = false;
    double step_size = 0;
    for (int attempt = 0; attempt < kMaxAttempts && !improved; ++attempt) {
      Matrix6d damped = equations.H;
      damped.diagonal() += damping * equations.H.diagonal();
      const Vector6d delta = -SolveSymmetric(damped, equations.g);
      if (!delta.allFinite()) return std::nullopt;
      const RigidTransform next = Retract(T, delta);
      Eigen::Matrix2Xd r_next;
      if (problem.Residuals(next, &r_next) && cost(r_next) < before) {
        T = next;
        r = r_next;
        damping = std::max(damping / 10, kLeastDamping);
        improved = true;
        step_size = delta.norm();
      } else {
        damping *= 10;
      }
    }
    if (!improved || step_size < kSmallStep) break;
  }
  return problem.Judge(T);
}

/// From the closed-form starts of `chosen` markers, refined on all.
std::optional<Candidate> FromStarts(std::span<const Ray> rays,
                                    const Eigen::Matrix3Xd& points,
                                    bool flat,
                                    std::span<const size_t> chosen) {
  std::vector<Ray> chosen_rays;
  Eigen::Matrix3Xd chosen_points(3, chosen.size());
  for (size_t i = 0; i < chosen.size(); ++i) {
    chosen_rays.push_back(rays[chosen[i]]);
    chosen_points.col(static_cast<Eigen::Index>(i)) =
        points.col(static_cast<Eigen::Index>(chosen[i]));
  }
  std::vector<RigidTransform> starts;
  if (flat || chosen.size() < 6) {
    starts.push_back(PlanarPose(chosen_rays, chosen_points));
    starts.push_back(MirroredTilt(starts.back()));
  } else {
    starts.push_back(SpatialPose(chosen_rays, chosen_points));
  }
  std::optional<Candidate> best;
  for (const RigidTransform& start : starts) {
    if (!start.t.allFinite() || !start.R.allFinite()) continue;
    const std::optional<Candidate> refined = Refine(rays, points, start);
    if (refined && (!best || refined->rms < best->rms)) best = refined;
  }
  return best;
}

}  // namespace

std::optional<Resection> Resect(std::span<const Ray> rays,
                                std::span<const Eigen::Vector3d> points) {
  if (points.size() < 4 || rays.size() != points.size()) return std::nullopt;
  const Spread spread = SpreadOf(points);
  if (!(spread.extent[1] > kLineWidth * spread.extent[0])) return std::nullopt;

  // Normalise: points in their principal axes with unit extent, so that tolerances have no unit.
  const double unit = spread.extent[0];
  Eigen::Matrix3Xd normalised(3, points.size());
  std::vector<Ray> scaled(rays.begin(), rays.end());
  for (size_t i = 0; i < points.size(); ++i) {
    normalised.col(static_cast<Eigen::Index>(i)) =
        spread.axes.transpose() * (points[i] - spread.centre) / unit;
    scaled[i].origin /= unit;
  }

  const bool flat = spread.extent[2] < kPlaneThickness * spread.extent[1];
  std::vector<size_t> chosen(points.size());
  std::iota(chosen.begin(), chosen.end(), 0);
  std::optional<Candidate> best = FromStarts(scaled, normalised, flat, chosen);
  // A misread marker may have spoilt the start: ten medians are seven standard deviations of normal
  // errors, and no noise is a twentieth of what the target spans. Halves drawn at random miss two
  // misread tags with a probability of 1/4 each; a tag's markers are neighbours.
  constexpr double kNotNoise = 10, kOfSpan = 0.05;
  constexpr int kHalves = 16, kTogether = 4;
  if (!best || best->largest > kNotNoise * best->median ||
      best->best_part > kOfSpan * AngularSpan(rays)) {
    std::minstd_rand random;
    for (int half = 0; half < kHalves; ++half) {
      chosen.clear();
      bool take = false;
      for (size_t i = 0; i < points.size(); ++i) {
        if (i % kTogether == 0) take = random() > random.max() / 2;
        if (take) chosen.push_back(i);
      }
      if (chosen.size() < 6) continue;
      const auto other = FromStarts(scaled, normalised, flat, chosen);
      if (other && (!best || other->best_part < best->best_part)) best = other;
    }
  }
  if (!best) return std::nullopt;
  // Undo the normalisation: p_cam = unit * (R axes' (p - centre) / unit + t).
  const Eigen::Matrix3d R = best->T.R * spread.axes.transpose();
  return Resection{{R, unit * best->T.t - R * spread.centre}, best->rms};
}

}  // namespace plenocal
