// SPDX-License-Identifier: Apache-2.0
#include "models/spline/spline_lens.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "calib/base/invert_map.h"
#include "models/start/central_model.h"

namespace plenocal {
namespace {

// A direction and u, which does not depend on its length.
struct Seen {
  Eigen::Vector2d u = {};
  double size = 0;      ///< largest coordinate of p
  Eigen::Vector3d p{};  ///< scaled to a largest coordinate of 1: no square overflows
};

bool See(const Eigen::Vector3d& p, Seen* seen) {
  seen->size = p.cwiseAbs().maxCoeff();
  if (!(seen->size >= std::numeric_limits<double>::min() && std::isfinite(seen->size))) {
    return false;
  }
  seen->p = p / seen->size;
  return ProjectStereographic(seen->p, &seen->u);
}

// Derivatives of u by p.
Eigen::Matrix<double, 2, 3> StereographicSlope(const Seen& seen) {
  const Eigen::Vector3d& p = seen.p;
  const double d = p.norm(), r2 = p.head<2>().squaredNorm();
  const double depth = p.z() > 0 ? d + p.z() : r2 / (d - p.z());
  Eigen::Matrix<double, 2, 3> slope;
  slope.leftCols<2>() =
      2 / depth * Eigen::Matrix2d::Identity() - seen.u / (depth * d) * p.head<2>().transpose();
  slope.col(2) = -seen.u / d;
  return slope / seen.size;
}

// The spline at a place, and its derivatives by the place.
struct Sums {
  Eigen::Vector2d value = Eigen::Vector2d::Zero(), by_i = value, by_j = value;
};

template <size_t kCount>
Sums SumOfKnots(const double* first,
                int stride,
                const KnotWeights& along,
                const KnotWeights& down) {
  Sums sums;
  for (size_t b = 0; b < kCount; ++b, first += stride) {
    Eigen::Vector2d sum = Eigen::Vector2d::Zero(), slope = sum;
    for (size_t a = 0; a < kCount; ++a) {
      const Eigen::Vector2d value(first[2 * a], first[2 * a + 1]);
      sum += along.weight[a] * value;
      slope += along.slope[a] * value;
    }
    sums.value += down.weight[b] * sum;
    sums.by_i += down.weight[b] * slope;
    sums.by_j += down.slope[b] * sum;
  }
  return sums;
}

bool Finite(const double* predicted) {
  return std::isfinite(predicted[0]) && std::isfinite(predicted[1]);
}

std::optional<Eigen::Vector3d> SolveFrom(const SplineLens& lens,
                                         const double* params,
                                         const Eigen::Vector2d& m,
                                         const Eigen::Vector2d& start) {
  constexpr double kLastStep = 1e-9;  // its square, the error after it, is rounding
  SplineLens::Image at;
  const auto map = [&](const Eigen::Vector2d& u, Eigen::Vector2d* image, Eigen::Matrix2d* slope) {
    if (!lens.Distort(params, u, &at)) return false;
    *image = at.m;
    *slope = at.by_u;
    return true;
  };
  const std::optional<Eigen::Vector2d> u = InvertMap(map, m, start, kLastStep);
  if (!u) return std::nullopt;
  return UnitDirection({u->x(), u->y(), 1 - u->squaredNorm() / 4});
}

}  // namespace

bool ProjectStereographic(const Eigen::Vector3d& p, Eigen::Vector2d* u) {
  const double r2 = p.head<2>().squaredNorm(), d = std::sqrt(r2 + p.z() * p.z());
  // 1 / (d + z), behind the camera without cancellation.
  if (!(p.z() > 0 || r2 > 0)) return false;
  *u = p.head<2>() * (p.z() > 0 ? 2 / (d + p.z()) : 2 * (d - p.z()) / r2);
  return true;
}

double SplineLens::KnotsPerUnit(double fov_deg) const {
  return (columns - order) / (4 * std::tan(fov_deg * (std::numbers::pi / 720)));
}

KnotWeights SplineLens::WeightsAt(double place, int knots) const {
  KnotWeights at;
  if (order == 2) {  // about the nearest knot
    const int nearest = std::clamp(static_cast<int>(place + 0.5), 1, knots - 2);
    const double t = place - nearest;
    at.first = nearest - 1;
    at.weight = {(2 * t - 1) * (2 * t - 1) / 8, (3 - 4 * t * t) / 4, (2 * t + 1) * (2 * t + 1) / 8};
    at.slope = {t - 0.5, -2 * t, t + 0.5};
    return at;
  }
  at.first = std::clamp(static_cast<int>(place) - 1, 0, knots - 4);
  const double t = place - (at.first + 1), t2 = t * t, t3 = t2 * t;
  at.weight = {(1 - 3 * t + 3 * t2 - t3) / 6,
               (4 - 6 * t2 + 3 * t3) / 6,
               (1 + 3 * t + 3 * t2 - 3 * t3) / 6,
               t3 / 6};
  at.slope = {-(1 - t) * (1 - t) / 2, (3 * t - 4) * t / 2, (1 + 2 * t - 3 * t2) / 2, t2 / 2};
  return at;
}

bool SplineLens::Distort(const double* params, const Eigen::Vector2d& u, Image* image) const {
  const double s = KnotsPerUnit(params[kFov]);
  const double i = s * u.x() + (columns - 1) / 2.0, j = s * u.y() + (rows - 1) / 2.0;
  if (!(i >= 0 && i <= columns - 1 && j >= 0 && j <= rows - 1)) return false;
  image->along = WeightsAt(i, columns);
  image->down = WeightsAt(j, rows);
  const double* const first = params + KnotPlace(image->along.first, image->down.first);
  const Sums sums = order == 2 ? SumOfKnots<3>(first, 2 * columns, image->along, image->down)
                               : SumOfKnots<4>(first, 2 * columns, image->along, image->down);
  image->m = u + sums.value;
  image->by_place << sums.by_i, sums.by_j;
  image->by_u = Eigen::Matrix2d::Identity() + s * image->by_place;
  // A map of a convex region whose slope has a positive definite symmetric part has an inverse.
  const Eigen::Matrix2d symmetric = image->by_u + image->by_u.transpose();
  return symmetric(0, 0) > 0 && symmetric.determinant() > 0;
}

bool SplineLens::Project(const double* params, const Eigen::Vector3d& p, double* predicted) const {
  Seen seen;
  Image image;
  if (!See(p, &seen) || !Distort(params, seen.u, &image)) return false;
  for (int r = 0; r < 2; ++r) predicted[r] = params[r] * image.m[r] + params[2 + r];
  return Finite(predicted);
}

bool SplineLens::ProjectWithJacobian(const double* params,
                                     const Eigen::Vector3d& p,
                                     const ProjectionOutput& out) const {
  Seen seen;
  Image image;
  if (!See(p, &seen) || !Distort(params, seen.u, &image)) return false;
  const Eigen::Matrix<double, 2, 3> by_p = image.by_u * StereographicSlope(seen);
  for (int r = 0; r < 2; ++r) {
    out.predicted[r] = params[r] * image.m[r] + params[2 + r];
    Eigen::Map<Eigen::RowVector3d>(out.J_point + 3 * r) = params[r] * by_p.row(r);
    if (out.J_h != nullptr) out.J_h[r] = 0;
  }
  if (out.support != nullptr) WriteSupport(image, out.support);
  if (out.J_params != nullptr) {
    // By fov, which changes the place: d s / d fov = -2 s / sin(fov / 2) d(fov / 4).
    constexpr double kHalf = std::numbers::pi / 360;
    const double s = KnotsPerUnit(params[kFov]);
    const Eigen::Vector2d by_fov =
        image.by_place * seen.u * (-s / std::sin(params[kFov] * kHalf) * kHalf);
    const size_t width = out.support != nullptr ? SupportSize() : ParamCount();
    std::fill_n(out.J_params, 2 * width, 0.0);
    for (int r = 0; r < 2; ++r) {
      double* const row = out.J_params + static_cast<size_t>(r) * width;
      row[r] = image.m[r];
      row[2 + r] = 1;
      row[kFov] = params[r] * by_fov[r];
      for (int b = 0; b <= order; ++b) {
        const size_t in_support = kFirstKnot + 2 * static_cast<size_t>(b * (order + 1));
        double* const first =
            row + r +
            (out.support != nullptr ? in_support
                                    : KnotPlace(image.along.first, image.down.first + b));
        const double down = params[r] * image.down.weight[static_cast<size_t>(b)];
        for (size_t a = 0; a <= static_cast<size_t>(order); ++a) {
          first[2 * a] = down * image.along.weight[a];
        }
      }
    }
  }
  return Finite(out.predicted);
}

void SplineLens::WriteSupport(const Image& image, size_t* support) const {
  for (size_t k = 0; k < kFirstKnot; ++k) *support++ = k;
  for (int b = 0; b <= order; ++b) {
    const size_t first = KnotPlace(image.along.first, image.down.first + b);
    for (int i = 0; i < 2 * (order + 1); ++i) *support++ = first + static_cast<size_t>(i);
  }
}

std::optional<Eigen::Vector3d> SplineLens::Unproject(const double* params,
                                                     const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d m((pixel.x() - params[2]) / params[0], (pixel.y() - params[3]) / params[1]);
  const double s = KnotsPerUnit(params[kFov]);
  const Eigen::Vector2d edge((columns - 1) / 2.0 / s, (rows - 1) / 2.0 / s);
  if (!m.allFinite()) return std::nullopt;
  // The map is near the identity: m itself first, then places all over the rectangle.
  if (auto direction = SolveFrom(*this, params, m, m.cwiseMax(-edge).cwiseMin(edge))) {
    return direction;
  }
  constexpr int kStarts = 9;
  for (int row = 0; row < kStarts; ++row) {
    for (int column = 0; column < kStarts; ++column) {
      const Eigen::Vector2d part(2.0 * column / (kStarts - 1) - 1, 2.0 * row / (kStarts - 1) - 1);
      if (auto direction = SolveFrom(*this, params, m, edge.cwiseProduct(part))) return direction;
    }
  }
  return std::nullopt;
}

}  // namespace plenocal
