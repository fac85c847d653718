// SPDX-License-Identifier: Apache-2.0
//
// The virtual image of a camera with micro lenses, and its rays and points in space.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "calib/files/calibration_record.h"
#include "engine/resample/pinhole_view.h"

namespace plenocal {

/// A virtual image point q (raw px) of inverse virtual depth w is seen in the micro image centred
/// at c at c + w (q - c) (docs/plenoptic.md). The rays of these positions by the camera's model
/// meet in the point; only these rays are used.
///
/// The ray through the micro lens at q itself does not depend on w. All these rays meet in one
/// point, the centre of the view: the virtual image is that of a central camera there.
class VirtualImage {
 public:
  /// Throws `Error` of kind kInput for a camera without micro lenses. `camera` must outlive this.
  explicit VirtualImage(const CalibratedCamera& camera);

  /// T_view_camera: the view's frame is the camera's with its origin at the centre of the view.
  [[nodiscard]] RigidTransform ViewFromCamera() const;
  /// Direction of the ray of q, of any length.
  [[nodiscard]] std::optional<Eigen::Vector3d> Direction(const Eigen::Vector2d& q) const;
  /// The inverse of Direction.
  [[nodiscard]] std::optional<Eigen::Vector2d> Place(const Eigen::Vector3d& direction) const;
  /// The point in the view's frame, m; nothing for one that is not before the camera.
  [[nodiscard]] std::optional<Eigen::Vector3d> Point(const Eigen::Vector2d& q,
                                                     double inverse_depth) const;
  /// A point, and the standard deviation of its z for that of the inverse virtual depth, `sigma`.
  struct UncertainPoint {
    Eigen::Vector3d p;
    double sigma_z = 0;
  };
  [[nodiscard]] std::optional<UncertainPoint> Point(const Eigen::Vector2d& q,
                                                    double inverse_depth,
                                                    double sigma) const;

  /// The virtual image with `scale` raw px per pixel.
  [[nodiscard]] SeenImage Seen(double scale) const;
  static ImageSize SizeAt(ImageSize raw, double scale);

 private:
  [[nodiscard]] std::optional<Ray> RayOf(const Eigen::Vector2d& place,
                                         const Eigen::Vector2d& lens) const;

  const CalibratedCamera& camera_;
  Eigen::Vector3d centre_ = Eigen::Vector3d::Zero();  // in the camera's frame
  Eigen::Vector2d f_{0, 0}, c_{0, 0};                 // on the axis, raw px
};

}  // namespace plenocal
