// SPDX-License-Identifier: Apache-2.0
#include "models/start/axis_point.h"

#include <cmath>

namespace plenocal {
namespace {

// z_p and w of the header for one ray, with derivatives by its angle and the parameters.
struct AxisPoint {
  AxisPoint(const LensPart& part, const double* a, double theta) {
    w = part.ray_offset(a, theta, &w_by_theta, w_by_a.data());
    const double sine = std::sin(theta);
    if (!(sine > 0)) return;  // on the axis
    z_p = w / sine;
    z_by_theta = (w_by_theta - z_p * std::cos(theta)) / sine;
    for (size_t i = 0; i < part.params.size(); ++i) z_by_a[i] = w_by_a[i] / sine;
  }

  double w = 0, w_by_theta = 0, z_p = 0, z_by_theta = 0;
  std::array<double, kMostPartParams> w_by_a{}, z_by_a{};
};

}  // namespace

std::optional<ShiftedPoint> ShiftToLens(const LensPart& part,
                                        const double* a,
                                        const Eigen::Vector3d& p,
                                        double h) {
  constexpr int kMostSteps = 20;
  constexpr double kLastStep = 1e-9;  // rad; its square, the error after it, is rounding
  // Of the slope without a shift: nearer to zero, two rays through the point nearly coincide.
  constexpr double kLeastSlope = 1e-3;
  const double r = std::hypot(p.x(), p.y()), distance = std::hypot(r, p.z());
  if (!(distance > 0 && std::isfinite(distance))) return std::nullopt;
  double theta = std::atan2(r, p.z());
  for (int step = 0; step < kMostSteps; ++step) {
    if (!(theta >= 0 && theta < part.largest_angle)) return std::nullopt;
    const AxisPoint at(part, a, theta);
    const double sine = std::sin(theta), cosine = std::cos(theta);
    const double slope = -r * sine - p.z() * cosine + h * at.w_by_theta;
    if (!(slope < -kLeastSlope * distance)) return std::nullopt;
    const double change = -(r * cosine - p.z() * sine + h * at.w) / slope;
    theta = std::max(0.0, theta + change);
    if (std::abs(change) < kLastStep) {
      const Eigen::Vector2d azimuth =
          r > 0 ? Eigen::Vector2d(p.head<2>() / r) : Eigen::Vector2d::Zero();
      const AxisPoint found(part, a, theta);
      const double by_theta = h * found.z_by_theta / slope;
      ShiftedPoint shifted{.p = {p.x(), p.y(), p.z() - h * found.z_p}, .z_by_p = {}, .z_by_h = 0};
      shifted.z_by_p << by_theta * cosine * azimuth.transpose(), 1 - by_theta * sine;
      shifted.z_by_h = by_theta * found.w - found.z_p;
      for (size_t i = 0; i < part.params.size(); ++i) {
        shifted.z_by_a[i] = h * (by_theta * found.w_by_a[i] - found.z_by_a[i]);
      }
      return shifted;
    }
  }
  return std::nullopt;
}

std::optional<double> AxisPointOf(const LensPart& part,
                                  const double* a,
                                  const Eigen::Vector3d& direction) {
  const double theta = std::atan2(direction.head<2>().norm(), direction.z());
  if (!(theta < part.largest_angle)) return std::nullopt;
  return AxisPoint(part, a, theta).z_p;
}

}  // namespace plenocal
