// SPDX-License-Identifier: Apache-2.0
//
// The mathematics of models/splined.h, for any order and number of knots.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

#include "calib/camera/camera_model.h"

namespace plenocal {

/// What a spline's knots do along one axis: the first of those on which a place depends, their
/// weights, and the derivatives of these by the place.
struct KnotWeights {
  int first = 0;
  std::array<double, 4> weight{}, slope{};
};

struct SplineLens {
  static constexpr size_t kFov = 4, kFirstKnot = 5;  // among the parameters

  int order = 3, columns = 11, rows = 9;

  [[nodiscard]] int Knots() const { return columns * rows; }
  [[nodiscard]] size_t ParamCount() const { return kFirstKnot + 2 * static_cast<size_t>(Knots()); }
  [[nodiscard]] size_t SupportSize() const {
    return kFirstKnot + 2 * static_cast<size_t>((order + 1) * (order + 1));
  }
  /// Of knot (a, b)'s x among the parameters; y follows.
  [[nodiscard]] size_t KnotPlace(int a, int b) const {
    return kFirstKnot + 2 * static_cast<size_t>(b * columns + a);
  }
  /// The inverse, of x or y.
  [[nodiscard]] static Eigen::Index KnotOf(size_t place) {
    return static_cast<Eigen::Index>(place - kFirstKnot) / 2;
  }
  [[nodiscard]] double KnotsPerUnit(double fov_deg) const;
  /// Among the knots, of u.
  [[nodiscard]] Eigen::Vector2d Place(double fov_deg, const Eigen::Vector2d& u) const {
    return KnotsPerUnit(fov_deg) * u + Eigen::Vector2d(columns - 1, rows - 1) / 2;
  }
  [[nodiscard]] KnotWeights WeightsAt(double place, int knots) const;

  /// m at u with its slope by u and by the place; false outside the domain.
  struct Image {
    Eigen::Vector2d m = {};
    Eigen::Matrix2d by_place = {}, by_u = {};
    KnotWeights along = {}, down = {};
  };
  bool Distort(const double* params, const Eigen::Vector2d& u, Image* image) const;
  /// Indices of the parameters on which the image depends.
  void WriteSupport(const Image& image, size_t* support) const;

  bool Project(const double* params, const Eigen::Vector3d& p, double* predicted) const;
  bool ProjectWithJacobian(const double* params,
                           const Eigen::Vector3d& p,
                           const ProjectionOutput& out) const;
  [[nodiscard]] std::optional<Eigen::Vector3d> Unproject(const double* params,
                                                         const Eigen::Vector2d& pixel) const;
};

/// u of a direction; false straight behind.
bool ProjectStereographic(const Eigen::Vector3d& p, Eigen::Vector2d* u);

/// Start values of `kannala-brandt4`, each with the spline through its rays.
std::vector<StartCandidate> StartSpline(const CameraModel& model, const StartProblem& problem);

}  // namespace plenocal
