// SPDX-License-Identifier: Apache-2.0
//
// Which pinhole camera shows what others see.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <span>
#include <string>

#include "calib/calibration_file.h"

namespace plenocal {

/// What the user says of the new camera.
struct ViewOptions {
  std::optional<ImageSize> size;  ///< px; not set: that of the first camera
  std::optional<double> fov;      ///< horizontal field of view, degrees
  /// 0: the largest field of view of which every pixel has a source; 1: the smallest that shows all
  /// that the cameras see; between them in proportion. As alpha of cv::getOptimalNewCameraMatrix
  /// and balance of cv::fisheye, but with square pixels.
  std::optional<double> balance;
};

/// What a camera sees.
struct SeenImage {
  std::string name;  ///< of the camera
  ImageSize size{};  ///< px
  /// In which direction, of any length and in the camera's frame, a place of the image looks, px.
  std::function<std::optional<Eigen::Vector3d>(const Eigen::Vector2d& place)> direction;
  Eigen::Vector2d f, c;  ///< intrinsics as a pinhole has them at the optical axis, px
  /// How the view is turned from it: p_view = R_view_camera p_camera.
  Eigen::Matrix3d R_view_camera = Eigen::Matrix3d::Identity();
};

/// The image of an ordinary camera, which must outlive the result. Throws `Error` of kind kInput
/// when it is none.
SeenImage ImageOf(const CalibratedCamera& camera, const Eigen::Matrix3d& R_view_camera);

/// The one `pinhole` camera for all of `images`, without name and pose.
///
/// Without fov and balance one camera that is not turned keeps its scale on the optical axis, and
/// its principal point (times the change of size), as cv::undistort does; others get their mean
/// scale, and the directions of their images' centres in the middle. A field of view lies evenly
/// about the optical axis. Throws `Error` when a camera sees what no plane image holds.
CalibratedCamera ChoosePinhole(std::span<const SeenImage> images, const ViewOptions& options);

}  // namespace plenocal
