// SPDX-License-Identifier: Apache-2.0
//
// Views of a flat target without a camera model.
#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>
#include <vector>

#include "calib/start/camera_guess.h"

namespace plenocal {

/// A marker and its image point.
struct PlanePoint {
  int marker = 0;
  Eigen::Vector2d image;  ///< px; of a plenoptic camera the virtual image point's raw pixel
};

/// One view of the target.
struct PlaneView {
  std::vector<PlanePoint> points;
  double spacing = 0;            ///< px, typical distance of neighbouring points
  Eigen::Vector2d centre{0, 0};  ///< of the image, px
  double radius = 1;             ///< from there to the image's corners, px
};

/// Up to `limit` views with most points, those with fewer than `least` points left out. A marker
/// that a plenoptic camera sees through several micro lenses is one point: x = c + (p - c) / v is
/// solved for p.
std::vector<PlaneView> MakePlaneViews(const CameraInput& camera, size_t limit, size_t least);

/// A plane through all markers.
struct MarkerPlane {
  Eigen::Vector3d middle;
  Eigen::Vector3d x, y;  ///< orthonormal, in the plane
  double extent = 0;     ///< m, largest distance of a marker from the middle

  [[nodiscard]] Eigen::Vector2d operator()(const Eigen::Vector3d& p) const {
    return {x.dot(p - middle), y.dot(p - middle)};
  }
};

/// Nothing for fewer than four markers and for markers that lie in no plane.
std::optional<MarkerPlane> FindPlane(const std::map<int, Eigen::Vector3d>& markers);

}  // namespace plenocal
