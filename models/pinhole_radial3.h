// SPDX-License-Identifier: Apache-2.0
//
// Pinhole camera with three radial distortion terms.
//
// Source: Zeller et al., synchronized stereo and plenoptic VO dataset, "Stereo Camera Model". For
// p_cam = (x_C, y_C, z_C):
//
//   x = x_C / z_C, y = y_C / z_C                                     (normalised image coordinates)
//   r = sqrt(x^2 + y^2)
//   dx = x (A_0 r^2 + A_1 r^4 + A_2 r^6), dy = y (A_0 r^2 + A_1 r^4 + A_2 r^6)
//   x_Id = f_x (x + dx) + c_x, y_Id = f_y (y + dy) + c_y             (pixels)
//
// These are OpenCV's k1, k2, k3. Defined for z_C > 0 and up to the radius where the distorted
// radius r_d(r) = r (1 + A_0 r^2 + A_1 r^4 + A_2 r^6) ceases to grow: beyond it the image folds
// over and two directions would share one pixel.
#pragma once

#include <array>
#include <cmath>
#include <optional>

#include "calib/camera/camera_model.h"
#include "models/start/central_model.h"
#include "models/start/central_start.h"

namespace plenocal {

struct PinholeRadial3 : CentralModel {
  static constexpr std::string_view kName = "pinhole-radial3";
  static constexpr Usage kUsage = Usage::kCommon;
  static constexpr std::string_view kSource =
      "Zeller et al., synchronized stereo and plenoptic VO dataset, \"Stereo Camera Model\"";
  static constexpr std::array kParams{Param{"f_x", "px", 0},
                                      Param{"f_y", "px", 0},
                                      Param{"c_x", "px"},
                                      Param{"c_y", "px"},
                                      Param{.name = "A_0", .unit = "1", .scale = 1, .neutral = 0},
                                      Param{.name = "A_1", .unit = "1", .scale = 1, .neutral = 0},
                                      Param{.name = "A_2", .unit = "1", .scale = 1, .neutral = 0}};
  static constexpr std::array kExample{400.0, 405.0, 322.0, 243.0, -0.2, 0.06, -0.008};
  static constexpr ImageSize kExampleSize{640, 480};

  // Whether r_d grows over all of [0, r], with s = r^2: r_d'(s) = 1 + 3 A_0 s + 5 A_1 s^2 + 7 A_2
  // s^3 must stay positive, so its value at s and at its minima inside are looked at.
  static bool Grows(double A_0, double A_1, double A_2, double s) {
    const auto slope = [&](double q) { return 1 + q * (3 * A_0 + q * (5 * A_1 + q * 7 * A_2)); };
    if (!(slope(s) > 0)) return false;
    // Extrema where 3 A_0 + 10 A_1 q + 21 A_2 q^2 = 0, by the form that does not cancel.
    const double discriminant = 25 * A_1 * A_1 - 63 * A_2 * A_0;
    if (discriminant < 0) return true;
    const double k = -(5 * A_1 + std::copysign(std::sqrt(discriminant), A_1));
    for (const double q : {k / (21 * A_2), 3 * A_0 / k}) {
      if (q > 0 && q < s && !(slope(q) > 0)) return false;
    }
    return true;
  }

  /// u_px = (x_Id, y_Id); false behind the camera and where the image folds over.
  template <typename T>
  static bool Project(const T* params, const Vector3<T>& p_cam, T* u_px) {
    const T &f_x = params[0], &f_y = params[1], &c_x = params[2], &c_y = params[3];
    const T &A_0 = params[4], &A_1 = params[5], &A_2 = params[6];
    if (!(p_cam.z() > 0.0)) return false;
    const T z_inverse = 1.0 / p_cam.z();
    const T x = p_cam.x() * z_inverse;
    const T y = p_cam.y() * z_inverse;
    const T r2 = x * x + y * y;
    if (!Grows(ValueOf(A_0), ValueOf(A_1), ValueOf(A_2), ValueOf(r2))) return false;
    const T stretch = 1.0 + r2 * (A_0 + r2 * (A_1 + r2 * A_2));
    u_px[0] = f_x * (x * stretch) + c_x;
    u_px[1] = f_y * (y * stretch) + c_y;
    return true;
  }

  /// Direction in which a pixel looks; nothing where no direction is imaged.
  static std::optional<Eigen::Vector3d> Unproject(const double* params,
                                                  const Eigen::Vector2d& u_px) {
    const double A_0 = params[4], A_1 = params[5], A_2 = params[6];
    const Eigen::Vector2d distorted((u_px.x() - params[2]) / params[0],
                                    (u_px.y() - params[3]) / params[1]);
    const double r_d = distorted.norm();
    const std::optional<double> r = SolveIncreasing(
        [&](double q) { return q * (1 + q * q * (A_0 + q * q * (A_1 + q * q * A_2))); },
        [&](double q) { return 1 + q * q * (3 * A_0 + q * q * (5 * A_1 + q * q * 7 * A_2)); },
        [&](double q) { return Grows(A_0, A_1, A_2, q * q); },
        r_d);
    if (!r) return std::nullopt;
    const double shrink = r_d > 0 ? *r / r_d : 1;
    return Eigen::Vector3d(distorted.x() * shrink, distorted.y() * shrink, 1).normalized();
  }

  static std::vector<StartCandidate> Start(const StartProblem& problem) {
    return StartCentral(
        MakeCameraModel<PinholeRadial3>(), problem, [](double f, double c_x, double c_y) {
          return std::vector<std::vector<double>>{{f, f, c_x, c_y, 0, 0, 0}};
        });
  }
};

}  // namespace plenocal
