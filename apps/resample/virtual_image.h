// SPDX-License-Identifier: Apache-2.0
//
// Where the virtual image of a camera with micro lenses lies in space.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "apps/undistort/pinhole_view.h"
#include "calib/calibration_file.h"

namespace plenocal {

/// A virtual image point q (raw px) of inverse virtual depth w is seen in the micro image centred
/// at c at c + w (q - c) (FORMATS.md, "Virtual depth"). The rays of these places, which the
/// camera's model gives, meet in the point; nothing else is asked of the model.
///
/// The ray through the micro lens at q itself does not depend on w. All these rays meet in one
/// point, the centre of the view: the virtual image is what a camera there sees.
class VirtualImage {
 public:
  /// Throws `Error` of kind kInput for a camera without micro lenses. `camera` must outlive this.
  explicit VirtualImage(const CalibratedCamera& camera);

  /// Of the view's frame, which is the camera's with its origin at the centre.
  [[nodiscard]] RigidTransform ViewFromCamera() const;
  /// In which direction q looks; of any length.
  [[nodiscard]] std::optional<Eigen::Vector3d> Direction(const Eigen::Vector2d& q) const;
  /// The inverse of Direction: q that looks there.
  [[nodiscard]] std::optional<Eigen::Vector2d> Place(const Eigen::Vector3d& direction) const;
  /// The point in the view's frame, m; nothing for one that is not before the camera.
  [[nodiscard]] std::optional<Eigen::Vector3d> Point(const Eigen::Vector2d& q,
                                                     double inverse_depth) const;
  /// A point, and the standard deviation of its z that `sigma` of the inverse virtual depth makes.
  struct UncertainPoint {
    Eigen::Vector3d p;
    double sigma_z = 0;
  };
  [[nodiscard]] std::optional<UncertainPoint> Point(const Eigen::Vector2d& q,
                                                    double inverse_depth,
                                                    double sigma) const;

  /// The virtual image with `scale` raw px a pixel.
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
