// SPDX-License-Identifier: Apache-2.0
//
// Spherical (equirectangular) image: longitude and latitude.
//
// Source: mrcal's LENSMODEL_LONLAT; Snyder, Map Projections (USGS Professional Paper 1395), section
// 12:
//
//   longitude = atan2(x_C, z_C),  latitude = atan2(y_C, sqrt(x_C^2 + z_C^2))
//   x_Id = f_x longitude + c_x, y_Id = f_y latitude + c_y            (pixels; f in px / rad)
//
// Defined but on the half plane x_C = 0, z_C <= 0, which holds the poles and the seam of the image.
#pragma once

#include <numbers>

#include "models/start/central_model.h"

namespace plenocal {

struct Spherical : CentralModel {
  static constexpr std::string_view kName = "spherical";
  static constexpr std::string_view kSource = "Snyder, Map Projections, section 12; mrcal's LONLAT";
  static constexpr std::array kParams{
      Param{"f_x", "px", 0},
      Param{"f_y", "px", 0},
      // Only turns the camera about its y axis.
      Param{.name = "c_x", .unit = "px", .fixed = Fixed::kAgainstPoses},
      Param{"c_y", "px"}};
  static constexpr std::array kExample{162.0, 163.0, 507.5, 161.0};
  static constexpr ImageSize kExampleSize{1016, 320};

  template <typename T>
  static bool Project(const T* params, const Vector3<T>& p_cam, T* u_px) {
    using std::atan2, std::sqrt;
    const double size = std::max(
        {std::abs(ValueOf(p_cam.x())), std::abs(ValueOf(p_cam.y())), std::abs(ValueOf(p_cam.z()))});
    if (!(size >= std::numeric_limits<double>::min() && std::isfinite(size))) return false;
    const Vector3<T> p(p_cam.x() / size, p_cam.y() / size, p_cam.z() / size);
    constexpr double kSeam = 1e-9;  // rad: nearer to it neither side is certain
    if (!(p.z() > kSeam || std::abs(ValueOf(p.x())) > kSeam)) return false;
    u_px[0] = params[0] * atan2(p.x(), p.z()) + params[2];
    u_px[1] = params[1] * atan2(p.y(), sqrt(p.x() * p.x() + p.z() * p.z())) + params[3];
    return std::isfinite(ValueOf(u_px[0])) && std::isfinite(ValueOf(u_px[1]));
  }

  static std::optional<Eigen::Vector3d> Unproject(const double* params,
                                                  const Eigen::Vector2d& u_px) {
    const double longitude = (u_px.x() - params[2]) / params[0];
    const double latitude = (u_px.y() - params[3]) / params[1];
    if (!(std::abs(longitude) < std::numbers::pi && std::abs(latitude) < std::numbers::pi / 2)) {
      return std::nullopt;
    }
    return Eigen::Vector3d(std::sin(longitude) * std::cos(latitude),
                           std::sin(latitude),
                           std::cos(longitude) * std::cos(latitude));
  }

  static std::vector<StartCandidate> Start(const StartProblem& problem) {
    const auto near_axis = [](double f, double c_x, double c_y) {
      return std::vector<std::vector<double>>{{f, f, c_x, c_y}};
    };
    std::vector<StartCandidate> candidates =
        StartCentral(MakeCameraModel<Spherical>(), problem, near_axis);
    // Most such images are whole panoramas.
    std::vector<double> panorama = near_axis(problem.image_size[0] / (2 * std::numbers::pi),
                                             (problem.image_size[0] - 1) / 2.0,
                                             (problem.image_size[1] - 1) / 2.0)[0];
    for (size_t i = 0; i < panorama.size(); ++i) {
      panorama[i] = problem.given[i].value_or(panorama[i]);
    }
    // Fits to directions move c_x, which the poses do as well.
    for (StartCandidate& candidate : candidates) candidate.params[2] = panorama[2];
    candidates.insert(candidates.begin(), {std::move(panorama)});
    return candidates;
  }
};

}  // namespace plenocal
