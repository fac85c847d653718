// SPDX-License-Identifier: Apache-2.0
//
// A target as it is printed: black shapes on white parts. Printing and simulation draw from this.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera/rigid_transform.h"

namespace plenocal {

using Polygon = std::vector<Eigen::Vector2d>;

/// A black disc around a marker.
struct Disc {
  Eigen::Vector2d centre{0, 0};
  double radius = 0;
  int marker = 0;
};

/// A tag on a part.
struct DrawnTag {
  int id = 0;
  Polygon outline;  ///< its four corners in the order of its markers
  Polygon paper;    ///< with the bits around the outline; papers do not overlap
};

/// Markers at the corners of squares: number row * columns + column at
/// first + pitch * (column, row).
struct SquareGrid {
  int columns = 0, rows = 0;
  double first = 0, pitch = 0;  ///< m
};

/// A flat part of a target. Coordinates in its plane, m: x right, y down, seen from the front.
struct TargetPart {
  /// z points away from the viewer.
  RigidTransform T_target_part;
  /// White paper with the quiet zone that the detectors need.
  Eigen::AlignedBox2d paper;
  std::vector<Polygon> black;
  std::vector<Disc> black_discs;
  std::vector<DrawnTag> tags;         ///< of targets of tags
  std::optional<SquareGrid> squares;  ///< of boards whose markers are corners of squares
  bool one_sheet = true;              ///< all of `paper` is white; else only that of each tag
  double finest = 0;                  ///< m, smallest width of a shape
  std::string label;                  ///< name of the pattern for a print's foot; may be empty
};

/// How the pieces of a target (tags) are collected into parts. Boards are one part either way.
enum class Pieces {
  kByPlane,  ///< those that lie in one plane are one part
  kApart     ///< each is a part of its own
};

}  // namespace plenocal
