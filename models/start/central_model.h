// SPDX-License-Identifier: Apache-2.0
//
// Common part of the models of ordinary cameras.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <string_view>
#include <type_traits>

#include "calib/base/invert_map.h"
#include "calib/camera/camera_model.h"
#include "models/start/central_start.h"

namespace plenocal {

/// Common part of all models of ordinary cameras: a point (x, y) in the image is seen along a ray
/// through the camera frame's origin.
struct CentralModel {
  static constexpr std::array<std::string_view, 2> kMeasured{"x", "y"};
  static constexpr std::array<std::string_view, 0> kContext{};
  static constexpr std::array<Param, 0> kConfig{};
  static constexpr std::array<double, 0> kExampleConfig{};
  static constexpr Centre kCentre = Centre::kPoint;
  static constexpr bool kPlenoptic = false;

  /// Whether a fisheye (`kannala-brandt4`) explains the views far better than the model's best
  /// initial guess, with residuals of median length `median_error`, px; impossible when it sees
  /// points 90 degrees and more off the axis where the model images nothing. In
  /// check/central_misfit.cc.
  static Misfit JudgeFit(const CameraModel& model,
                         const StartProblem& problem,
                         std::span<const double> params,
                         double median_error);
};

/// `f_x f_y c_x c_y`, then a lens' own parameters.
template <size_t N>
constexpr std::array<Param, 4 + N> WithIntrinsics(const std::array<Param, N>& lens) {
  std::array<Param, 4 + N> params{
      Param{"f_x", "px", 0}, Param{"f_y", "px", 0}, Param{"c_x", "px"}, Param{"c_y", "px"}};
  std::copy(lens.begin(), lens.end(), params.begin() + 4);
  return params;
}
/// A coefficient without unit that has no effect at 0.
constexpr Param Coefficient(std::string_view name, double scale = 1) {
  return {.name = name, .unit = "1", .scale = scale, .neutral = 0};
}

/// A direction with length 1; nothing for one that is not finite, or 0.
inline std::optional<Eigen::Vector3d> UnitDirection(const Eigen::Vector3d& direction) {
  const Eigen::Vector3d unit = direction.stableNormalized();
  if (!unit.allFinite() || !(unit.squaredNorm() > 0)) return std::nullopt;
  return unit;
}

/// Central models of the form u = (f_x m_x + c_x, f_y m_y + c_y), where the lens maps a direction
/// to m in the plane at distance 1. The struct M supplies, with k = its parameters after c_y,
///   static constexpr std::array kStart: k of a plain lens, from which start values are fitted; an
///     array of such arrays where one lets the fit end in the wrong one of several minima
///   template <typename T> static bool Map(const T* k, const Vector3<T>& p, T* m);
///   static std::optional<Eigen::Vector3d> Unmap(const double* k, const Eigen::Vector2d& m);
/// `Map` gets p scaled to a largest coordinate of 1 and returns false outside the lens' domain;
/// `Unmap` returns a direction of any length.
template <typename M>
struct LensModel : CentralModel {
  static constexpr ImageSize kExampleSize{640, 480};

  template <typename T>
  static bool Project(const T* params, const Vector3<T>& p_cam, T* u_px) {
    T m[2];
    if (!MapPoint(params + 4, p_cam, m)) return false;
    u_px[0] = params[0] * m[0] + params[2];
    u_px[1] = params[1] * m[1] + params[3];
    return std::isfinite(ValueOf(u_px[0])) && std::isfinite(ValueOf(u_px[1]));
  }

  /// Dual numbers carry the derivatives by the lens' parameters and the point alone.
  static bool ProjectWithJacobian(const double* params,
                                  const double* /*config*/,
                                  const double* /*values*/,
                                  const Eigen::Vector3d& p_cam,
                                  const ProjectionOutput& out) {
    return out.J_params == nullptr ? Differentiate<false>(params, p_cam, out)
                                   : Differentiate<true>(params, p_cam, out);
  }

  /// Direction in which a pixel looks; nothing where no direction is imaged.
  static std::optional<Eigen::Vector3d> Unproject(const double* params,
                                                  const Eigen::Vector2d& u_px) {
    const Eigen::Vector2d m((u_px.x() - params[2]) / params[0], (u_px.y() - params[3]) / params[1]);
    const std::optional<Eigen::Vector3d> direction = M::Unmap(params + 4, m);
    return direction ? UnitDirection(*direction) : std::nullopt;
  }

  static std::vector<StartCandidate> Start(const StartProblem& problem) {
    std::vector<std::vector<double>> lenses;
    for (const auto& lens : Starts()) lenses.emplace_back(lens.begin(), lens.end());
    return StartLens(MakeCameraModel<M>(), problem, lenses);
  }

 private:
  template <typename T>
  static bool MapPoint(const T* k, const Vector3<T>& p_cam, T* m) {
    const double size = std::max(
        {std::abs(ValueOf(p_cam.x())), std::abs(ValueOf(p_cam.y())), std::abs(ValueOf(p_cam.z()))});
    if (!(size >= std::numeric_limits<double>::min() && std::isfinite(size))) return false;
    // Directions count only: scaled, no square overflows.
    return M::Map(k, Vector3<T>(p_cam.x() / size, p_cam.y() / size, p_cam.z() / size), m);
  }

  template <bool kByParams>
  [[gnu::flatten, gnu::noinline]] static bool Differentiate(const double* params,
                                                            const Eigen::Vector3d& p_cam,
                                                            const ProjectionOutput& out) {
    constexpr int kParamCount = static_cast<int>(M::kParams.size()), kLens = kParamCount - 4;
    constexpr int kBefore = kByParams ? kLens : 0;
    using Jet = ceres::Jet<double, kBefore + 3>;
    std::array<Jet, kLens> k;
    for (int i = 0; i < kLens; ++i) {
      k[i] = kByParams ? Jet(params[4 + i], i) : Jet(params[4 + i]);
    }
    const Vector3<Jet> p(
        Jet(p_cam.x(), kBefore), Jet(p_cam.y(), kBefore + 1), Jet(p_cam.z(), kBefore + 2));
    Jet m[2];
    if (!MapPoint(k.data(), p, m)) return false;
    for (int r = 0; r < 2; ++r) {
      const double f = params[r];
      out.predicted[r] = f * m[r].a + params[2 + r];
      for (int i = 0; i < 3; ++i) out.J_point[3 * r + i] = f * m[r].v[kBefore + i];
      if constexpr (!kByParams) continue;
      double* const row = out.J_params + r * kParamCount;
      std::fill_n(row, 4, 0.0);
      row[r] = m[r].a;
      row[2 + r] = 1;
      for (int i = 0; i < kLens; ++i) row[4 + i] = f * m[r].v[i];
    }
    return std::isfinite(out.predicted[0]) && std::isfinite(out.predicted[1]);
  }

  static constexpr auto Starts() {
    if constexpr (requires { M::kStart[0].data(); }) {
      return M::kStart;
    } else {
      return std::array<std::remove_const_t<decltype(M::kStart)>, 1>{M::kStart};
    }
  }
};

/// atan2(r, z) / r for r^2 = r2, smooth on the axis. REQUIRES: r2 > 0 or z > 0.
template <typename T>
T AngleOverRadius(const T& r2, const T& z) {
  // Below this part of z^2 the series to r^6 is exact to rounding, and the root has no derivative.
  constexpr double kSeries = 1e-5;
  if (ValueOf(z) > 0 && ValueOf(r2) < kSeries * ValueOf(z) * ValueOf(z)) {
    const T q = r2 / (z * z);
    return (1.0 - q * (1.0 / 3 - q * (1.0 / 5 - q / 7.0))) / z;
  }
  using std::atan2, std::sqrt;
  const T r = sqrt(r2);
  return atan2(r, z) / r;
}

/// Whether c_0 + c_1 q + c_2 q^2 + ... is positive for all q in [0, s]: its coefficients in
/// Bernstein's basis bound it, and halving the interval makes the bound tight.
template <size_t N>
bool PositiveOn(const std::array<double, N>& c, double s) {
  double bound = c[0], power = 1;
  for (size_t i = 1; i < N; ++i) {
    power *= s;
    bound += std::min(c[i], 0.0) * power;
  }
  if (bound > 0 && std::isfinite(power)) return true;  // the usual case, cheap
  if (!std::isfinite(power)) return false;

  // b_j = sum_{i <= j} C(j, i) / C(n, i) c_i s^i
  std::array<double, N> b{};
  for (size_t j = 0; j < N; ++j) {
    double ratio = 1;  // C(j, i) / C(n, i) s^i
    for (size_t i = 0; i <= j; ++i) {
      b[j] += ratio * c[i];
      if (i < j) ratio *= s * static_cast<double>(j - i) / static_cast<double>(N - 1 - i);
    }
  }
  constexpr int kHalvings = 40;  // what touches zero within 1e-12 of the interval counts as a fold
  const auto positive = [](auto&& self, std::array<double, N> left, int halvings) -> bool {
    if (!(left.front() > 0 && left.back() > 0)) return false;
    if (std::all_of(left.begin(), left.end(), [](double value) { return value > 0; })) return true;
    if (halvings == 0) return false;
    std::array<double, N> right{};  // de Casteljau at the middle
    for (size_t level = 0; level < N; ++level) {
      right[N - 1 - level] = left[N - 1];
      for (size_t j = N - 1; j > level; --j) left[j] = std::midpoint(left[j - 1], left[j]);
    }
    return self(self, left, halvings - 1) && self(self, right, halvings - 1);
  };
  return positive(positive, b, kHalvings);
}

/// The r with value(r) = target >= 0, for a function that grows from value(0) = 0 wherever `valid`
/// holds, an interval from 0. Nothing when the value is not reached.
template <typename Value, typename Slope, typename Valid>
std::optional<double> SolveIncreasing(const Value& value,
                                      const Slope& slope,
                                      const Valid& valid,
                                      double target) {
  using Number = Eigen::Vector<double, 1>;
  constexpr double kLargest = 1e4;    // as a radius at distance 1: 89.99 degrees off the axis
  constexpr double kLastStep = 1e-9;  // its square, the error after it, is rounding
  constexpr int kHalvings = 40;
  const auto map = [&](const Number& r, Number* image, Number* by_r) {
    if (!valid(r[0])) return false;
    *image << value(r[0]);
    *by_r << slope(r[0]);
    return true;
  };
  double start = std::min(target, kLargest);
  for (int i = 0; i < kHalvings && !valid(start); ++i) start /= 2;
  const auto r = InvertMap<1>(map, Number(target), Number(start), kLastStep * (1 + start));
  if (!r || (*r)[0] > 2 * kLargest) return std::nullopt;
  return (*r)[0];
}

}  // namespace plenocal
