// SPDX-License-Identifier: Apache-2.0
//
// Positions of a plenoptic camera's micro lenses, and the rays that reach a raw pixel through them.
//
// Both follow from the camera model's `unproject(x, c)`, the ray from raw point x through the
// middle of the micro lens with micro-image centre c, and two properties of thin lenses
// (undistorted raw coordinates, T_f the virtual depth at which the micro lens is sharp):
//
//   - the micro-image centre is the image of the stop's middle, so unproject(c, c) passes through
//     it: such rays meet in the entrance pupil, and their slopes form a regular lattice;
//   - light through a point of the micro lens that stands a (in units of micro-image centres) off
//     its middle comes along the ray unproject(x + a (1 - 1 / T_f), c + a): the undeflected ray
//     through the middle of another micro lens at that point, refracted by a / f_micro.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "apps/simulate/spec/simulation_spec.h"
#include "calib/camera/micro_lens_array.h"

namespace plenocal::simulate {

class MicroLensOptics {
 public:
  /// REQUIRES: a plenoptic camera. Throws `Error` if the model has no ray for any pixel of its
  /// image, or too few micro lenses fit on it.
  explicit MicroLensOptics(const CameraSpec& camera);

  /// All micro lenses whose centre is on the sensor or at most a pitch beside it; those beside it
  /// are not part of `Array`.
  [[nodiscard]] const std::vector<MicroLens>& Lenses() const { return lenses_; }
  [[nodiscard]] MicroLensArray Array() const;

  /// The ray to raw position `x` (px) through the micro lens with image centre `c`.
  [[nodiscard]] std::optional<Ray> RayThrough(const Eigen::Vector2d& x,
                                              const Eigen::Vector2d& c) const;
  /// Entrance pupil, m, camera frame.
  [[nodiscard]] const Eigen::Vector3d& Pupil() const { return pupil_; }
  /// Image of a point through the pupil's middle alone, px: the centre of the micro image in whose
  /// middle the point would lie. Nothing outside the model's domain.
  [[nodiscard]] std::optional<Eigen::Vector2d> CentralImage(const Eigen::Vector3d& p_cam) const;
  /// Exact observations of a point through all micro lenses that image it.
  [[nodiscard]] std::vector<Observation> Observe(int marker, const Eigen::Vector3d& p_cam) const;

 private:
  /// Slope dx/dz, dy/dz of the ray through the pupil's middle that belongs to centre c.
  [[nodiscard]] std::optional<Eigen::Vector2d> Slope(const Eigen::Vector2d& c) const;
  /// Inverse of `Slope`.
  [[nodiscard]] std::optional<Eigen::Vector2d> FromSlope(const Eigen::Vector2d& slope) const;
  void FindPrincipalPoint();
  /// Centre of the micro image at a place of the regular lattice, px.
  [[nodiscard]] std::optional<Eigen::Vector2d> CentreOf(const Eigen::Vector2d& regular) const;

  const CameraSpec& camera_;
  Eigen::Vector2d principal_{0, 0};            // px, where the ray is parallel to the axis
  Eigen::Matrix2d px_by_slope_, slope_by_px_;  // at the principal point
  Eigen::Vector3d pupil_{0, 0, 0};
  Eigen::Matrix2d basis_;  // px, lattice vectors e_column, e_row of the regular lattice
  Eigen::Vector2d origin_{0, 0};
  std::vector<MicroLens> lenses_;
  Eigen::ArrayXXi index_;  // of lenses_ by column + most_ and row + most_; -1: none
  int most_ = 0;           // rows and columns run from -most_ to most_
};

}  // namespace plenocal::simulate
