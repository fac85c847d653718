// SPDX-License-Identifier: Apache-2.0
//
// A pinhole camera for the field of view of other cameras.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <span>
#include <string>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// The user's options for the new camera.
struct ViewOptions {
  std::optional<ImageSize> size = {};  ///< px; not set: that of the first camera
  std::optional<double> fov = {};      ///< horizontal field of view, degrees
  /// 0: the largest field of view in which every pixel has a source; 1: the smallest that contains
  /// the cameras' whole images; values between interpolate. As alpha of
  /// cv::getOptimalNewCameraMatrix and balance of cv::fisheye, but with square pixels.
  std::optional<double> balance = {};
  /// Of cameras without a single centre: where the view is exact, m (`CentralView`).
  std::optional<double> distance = {};
};

/// The image of a camera and the directions of its pixels.
struct SeenImage {
  std::string name;  ///< of the camera
  ImageSize size{};  ///< px
  /// Direction of the ray of an image position (px), in the camera's frame, of any length.
  std::function<std::optional<Eigen::Vector3d>(const Eigen::Vector2d& u_px)> direction;
  Eigen::Vector2d f, c;  ///< focal lengths and principal point of a pinhole camera with the same
                         ///< scale on the optical axis, px
  /// Rotation of the view: p_view = R_view_camera p_camera.
  Eigen::Matrix3d R_view_camera = Eigen::Matrix3d::Identity();
};

/// The image of a central camera, which must outlive the result. Throws as `RequireCentral`.
SeenImage ImageOf(const CalibratedCamera& camera, const Eigen::Matrix3d& R_view_camera);

/// The one `pinhole` camera for all of `images`, without name and pose.
///
/// Without fov and balance a single camera without rotation keeps its scale on the optical axis and
/// its principal point (times the change of size), as cv::undistort does; several cameras get their
/// mean scale, with the directions of their image centres in the middle. A field of view is
/// symmetric about the optical axis. Throws `Error` when a camera's field of view does not fit into
/// a plane image.
CalibratedCamera ChoosePinhole(std::span<const SeenImage> images, const ViewOptions& options);

/// The pinhole camera for a central one, with its name and pose. Throws `Error` as `ImageOf` and
/// `ChoosePinhole`.
CalibratedCamera UndistortedView(const CalibratedCamera& camera, const ViewOptions& options);

}  // namespace plenocal
