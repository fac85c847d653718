// SPDX-License-Identifier: Apache-2.0
//
// What a target looks like: black shapes on white parts. Printing and simulation draw from this.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "calib/rigid_transform.h"
#include "targets/target.h"

namespace plenocal {

using Polygon = std::vector<Eigen::Vector2d>;

/// A disc of a drawing.
struct Disc {
  Eigen::Vector2d centre{0, 0};
  double radius = 0;
};

/// Where one tag is on a part.
struct DrawnTag {
  int id = 0;
  Polygon outline;  ///< its four corners in the order of its markers
  Polygon paper;    ///< with the bits around the outline; papers do not overlap
};

/// A flat part of a target. Coordinates in its plane, m: x right, y down, seen from the front.
struct TargetPart {
  /// z points away from the viewer.
  RigidTransform T_target_part;
  /// White paper with the quiet zone that the detectors want.
  Eigen::AlignedBox2d paper;
  std::vector<Polygon> black;
  std::vector<Disc> black_discs;
  std::vector<DrawnTag> tags;  ///< of targets of tags
  bool one_sheet = true;       ///< all of `paper` is white; else only that of each tag
  double finest = 0;           ///< m, smallest width of a shape
};

/// Radius of the circles of a drawn grid, m: half of the way to the nearest circle is black, half
/// white.
double NominalRadius(const CirclesLayout& circles);

/// The parts of a target at their nominal places. Tags that lie in one plane are one part, or,
/// with `each_tag`, each a part of its own. Throws `Error` of kind kInput for type `markers`, which
/// cannot be drawn.
std::vector<TargetPart> DrawTarget(const Target& target, bool each_tag = false);

}  // namespace plenocal
