// SPDX-License-Identifier: Apache-2.0
//
// Common part of focused plenoptic cameras: thin main lens, micro lenses as pinholes.
//
// Source: Zeller et al., synchronized stereo and plenoptic VO dataset, "Plenoptic Camera Model". A
// point x_C = (x_C, y_C, z_C) is observed through one micro lens, whose micro-image centre c_Id was
// detected in the distorted raw image. With all image coordinates in metres about the principal
// point, image axes turned by 180 degrees:
//
//   c_I  = undistorted c_Id                                      (section's distortion, below)
//   c_ML = c_I b_P / (b_P + B)                                   (centre of the micro lens)
//   p_ML = c_ML f_L / (b_L0 - f_L), z_C0 = f_L b_L0 / (f_L - b_L0)      (eq. projected_micro_lens)
//   x_p  = (x_C - p_ML) / (z_C + z_C0)
//   x_ML = x_p f_L B / (f_L - b_L0) - c_ML B / (f_L - b_L0)      (eq. projected_micro_lens_4_new)
//   x_R  = x_ML + c_ML
//
// The micro images' centres are the exit pupil's images, b_P in front of the micro lenses. In the
// paper the thin lens is its own pupil, b_P = b_L0.
//
// The last three lines have no value for f_L = b_L0, where the virtual cameras are infinitely far.
// Inserted into each other they do, and this is what is computed: with 1/v = B (z_C - f_L) / d,
// d = f_L z_C - b_L0 (z_C - f_L), the inverse of the paper's virtual depth,
//
//   x_R = x_C f_L B / d + c_ML (1 - 1/v).
//
// Distortion of raw coordinates and of micro-image centres alike, r^2 = x^2 + y^2:
//
//   x_d = x + x (A_0 r^2 + A_1 r^4) + B_0 (r^2 + 2 x^2) + 2 B_1 x y
//   y_d = y + y (A_0 r^2 + A_1 r^4) + B_1 (r^2 + 2 y^2) + 2 B_0 x y
//   x_Rd' = x_d / pixel_size + c_x, likewise y                   (pixels)
//
// The array may be tilted against the sensor about its middle by small angles: then the micro lens
// at c_ML is delta = t . c_ML farther from the sensor and nearer to the main lens. With the sensor
// at D = b_P + B from the pupil, k = t . c_I / D, it is delta = b_P k / (1 + k), and all equations
// hold with b_P - delta, b_L0 - delta, B + delta in place of b_P, b_L0, B.
//
// A marker may have been measured by a template that was scaled for the virtual depth v_t (that of
// docs/plenoptic.md, by micro-image centres), which is not quite right: then it is displaced by
// (1 - v_t / v) (x_depth, y_depth), the change of the measured position with ln v_t.
//
// Defined for z_C > f_L (a real image exists), for virtual image points not between the micro
// lenses and the sensor (1/v < 1), and where the distortion does not fold the image over.
#pragma once

#include <Eigen/LU>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "calib/camera/camera_model.h"
#include "models/start/plenoptic_points.h"

namespace plenocal {

/// Parameters f_L, b_L0, B, c_x, c_y, A_0, A_1, B_0, B_1 and what a model adds; `kPupil` is the
/// place of b_P among them, `kTilt` that of the first of two angles t of the array, or -1.
template <int kPupil, int kTilt = -1>
struct PlenopticModel {
  // The scales of the distortion are of an image 10 mm wide that it would make another.
  static constexpr std::array kSharedParams{
      Param{"f_L", "m", 0},
      Param{"b_L0", "m", 0},
      Param{"B", "m", 0},
      Param{"c_x", "px"},
      Param{"c_y", "px"},
      Param{.name = "A_0", .unit = "m^-2", .scale = 1e4, .neutral = 0},
      Param{.name = "A_1", .unit = "m^-4", .scale = 1e8, .neutral = 0},
      Param{.name = "B_0", .unit = "m^-1", .scale = 1e2, .neutral = 0},
      Param{.name = "B_1", .unit = "m^-1", .scale = 1e2, .neutral = 0}};
  // No sensor has finer or coarser pixels: a unit was mistaken.
  static constexpr std::array kConfig{Param{"pixel_size", "m", 1e-7, 1e-3}};
  static constexpr std::array<std::string_view, 2> kMeasured{"x", "y"};
  static constexpr std::array<std::string_view, 2> kContext{"lens_x", "lens_y"};
  static constexpr std::array<std::string_view, 3> kOptionalContext{"depth", "x_depth", "y_depth"};
  static constexpr bool kCentral = false;
  static constexpr bool kPlenoptic = true;
  static constexpr std::array kExampleConfig{7.4e-6};
  static constexpr ImageSize kExampleSize{800, 780};

  static std::string Remedy(std::span<const size_t> weak, const DepthRange& seen) {
    return PlenopticRemedy(
        weak, kPupil, kTilt < 0 ? std::nullopt : std::optional<size_t>(kTilt), seen);
  }
  static void ReplicateFit(std::span<const Observation* const> of_marker,
                           std::span<const double> weights,
                           ReplicateResidual* residuals) {
    FitMicroImages(of_marker, weights, residuals);
  }
  static void AssignLensTypes(std::vector<View>* views) { FindLensTypes(views); }

  /// u_px = distorted raw coordinates; `lens_px` = (lens_x, lens_y, depth, x_depth, y_depth).
  template <typename T>
  static bool Project(const T* params,
                      const double* config,
                      const double* lens_px,
                      const Vector3<T>& p_cam,
                      T* u_px) {
    const T& f_L = params[0];
    const double pixel_size = config[0];
    const Vector2<T> c(params[3], params[4]);
    Vector2<T> c_I;
    if (!Undistort(
            params,
            Vector2<T>((Eigen::Vector2d(lens_px[0], lens_px[1]).cast<T>() - c) * T(pixel_size)),
            &c_I)) {
      return false;
    }
    const auto [b_P, b_L0, B] = DistancesAt(params, c_I);
    const T pupil = b_P / (b_P + B);
    const Vector2<T> c_ML = c_I * pupil;
    const T& z_C = p_cam.z();
    if (!(z_C > f_L)) return false;
    const T d = f_L * z_C - b_L0 * (z_C - f_L);
    if (d == T(0)) return false;
    const T inverse_v = B * (z_C - f_L) / d;
    if (!(inverse_v < 1.0)) return false;
    const Vector2<T> x_R = p_cam.template head<2>() * (f_L * B / d) + c_ML * (1.0 - inverse_v);
    if (!Unfolded(params, x_R)) return false;
    const Vector2<T> x_Rd = Distort(params, x_R);
    u_px[0] = x_Rd.x() / pixel_size + c.x();
    u_px[1] = x_Rd.y() / pixel_size + c.y();
    if (const double v_t = lens_px[2]; v_t != 0) {
      const T depth_error = 1.0 - v_t * (1.0 - pupil * (1.0 - inverse_v));
      u_px[0] -= depth_error * lens_px[3];
      u_px[1] -= depth_error * lens_px[4];
    }
    return true;
  }

  /// The ray that reaches the raw image at values[0..1] through the micro lens at values[2..3]. It
  /// starts in the main lens' front focal plane.
  static std::optional<Ray> Unproject(const double* params,
                                      const double* config,
                                      const double* values) {
    const double f_L = params[0];
    const Eigen::Vector2d c(params[3], params[4]);
    Eigen::Vector2d x_R, c_I;
    if (!Undistort(params,
                   Eigen::Vector2d((Eigen::Vector2d(values[0], values[1]) - c) * config[0]),
                   &x_R) ||
        !Undistort(params,
                   Eigen::Vector2d((Eigen::Vector2d(values[2], values[3]) - c) * config[0]),
                   &c_I)) {
      return std::nullopt;
    }
    const auto [b_P, b_L0, B] = DistancesAt(params, c_I);
    const Eigen::Vector2d c_ML = c_I * (b_P / (b_P + B));
    const Eigen::Vector2d x_ML = x_R - c_ML;
    // The images of the ray's points behind the main lens lie on x_ML / B. Its point at infinity is
    // the image of `origin`, its point on the micro lens that of origin - direction / ..., both by
    // the thin lens; their difference has no singularity at f_L = b_L0.
    Ray ray;
    ray.origin << x_ML * (f_L / B), f_L;
    ray.direction << c_ML * B - x_ML * (b_L0 - f_L), f_L * B;
    ray.direction.normalize();
    return ray;
  }

 private:
  /// Distances pupil - micro lens, main lens - micro lens, micro lens - sensor.
  template <typename T>
  struct Distances {
    T b_P, b_L0, B;
  };
  template <typename T>
  static Distances<T> DistancesAt(const T* params, const Vector2<T>& c_I) {
    const T &b_P = params[kPupil], &b_L0 = params[1], &B = params[2];
    if constexpr (kTilt < 0) {
      return {b_P, b_L0, B};
    } else {
      const T k = (params[kTilt] * c_I.x() + params[kTilt + 1] * c_I.y()) / (b_P + B);
      const T delta = b_P * k / (1.0 + k);
      return {b_P - delta, b_L0 - delta, B + delta};
    }
  }

  template <typename T>
  static Vector2<T> Distort(const T* params, const Vector2<T>& p) {
    const T &A_0 = params[5], &A_1 = params[6], &B_0 = params[7], &B_1 = params[8];
    const T &x = p.x(), &y = p.y();
    const T r2 = p.squaredNorm(), radial = 1.0 + r2 * (A_0 + r2 * A_1), xy = 2.0 * x * y;
    return {x * radial + B_0 * (r2 + 2.0 * x * x) + B_1 * xy,
            y * radial + B_1 * (r2 + 2.0 * y * y) + B_0 * xy};
  }

  static Eigen::Matrix2d DistortionJacobian(const std::array<double, 4>& AB,
                                            const Eigen::Vector2d& p) {
    const double x = p.x(), y = p.y(), r2 = p.squaredNorm();
    const double radial = 1 + r2 * (AB[0] + r2 * AB[1]), slope = 2 * (AB[0] + 2 * AB[1] * r2);
    const double across = x * y * slope + 2 * (AB[2] * y + AB[3] * x);
    Eigen::Matrix2d J;
    J << radial + x * x * slope + 6 * AB[2] * x + 2 * AB[3] * y, across,  //
        across, radial + y * y * slope + 6 * AB[3] * y + 2 * AB[2] * x;
    return J;
  }

  /// Whether the distortion preserves neighbourhoods at p and, its radial part, all the way there.
  template <typename T>
  static bool Unfolded(const T* params, const Vector2<T>& p) {
    const std::array AB{
        ValueOf(params[5]), ValueOf(params[6]), ValueOf(params[7]), ValueOf(params[8])};
    const Eigen::Vector2d at(ValueOf(p.x()), ValueOf(p.y()));
    const double r2 = at.squaredNorm();
    const auto radial_slope = [&](double s) { return 1 + s * (3 * AB[0] + 5 * s * AB[1]); };
    const double extremum = -3 * AB[0] / (10 * AB[1]);
    if (extremum > 0 && extremum < r2 && !(radial_slope(extremum) > 0)) return false;
    return radial_slope(r2) > 0 && DistortionJacobian(AB, at).determinant() > 0;
  }

  /// Newton's method on numbers; its last step on T carries the derivatives by the parameters.
  template <typename T>
  static bool Undistort(const T* params, const Vector2<T>& distorted, Vector2<T>* undistorted) {
    constexpr int kMaxIterations = 30;
    constexpr double kLastStep = 1e-8;  // relative; its square, the error after it, is rounding
    std::array<double, 9> values;
    for (size_t i = 0; i < values.size(); ++i) values[i] = ValueOf(params[i]);
    const std::array AB{values[5], values[6], values[7], values[8]};
    const Eigen::Vector2d goal(ValueOf(distorted.x()), ValueOf(distorted.y()));
    Eigen::Vector2d p = goal;
    double last_step = std::numeric_limits<double>::infinity();
    for (int i = 0; i < kMaxIterations; ++i) {
      const Eigen::Vector2d step =
          DistortionJacobian(AB, p).inverse() * (goal - Distort(values.data(), p));
      // At the limit of rounding the steps cease to shrink.
      if (!step.allFinite() || (i > 3 && step.norm() >= last_step)) break;
      p += step;
      last_step = step.norm();
      if (last_step <= kLastStep * goal.norm()) break;
    }
    if (!p.allFinite() || !Unfolded(values.data(), p)) return false;
    const Eigen::Matrix2d inverse = DistortionJacobian(AB, p).inverse();
    const Vector2<T> rest = distorted - Distort(params, Vector2<T>(p.cast<T>()));
    if (!(std::hypot(ValueOf(rest.x()), ValueOf(rest.y())) <= kUndistorted * goal.norm() + 1e-15))
      return false;
    *undistorted = p.cast<T>() + inverse.cast<T>() * rest;
    return true;
  }

  static constexpr double kUndistorted = 1e-9;  // relative; a tenth of a nanometre on a sensor
};

}  // namespace plenocal
