// SPDX-License-Identifier: Apache-2.0
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "calib/base/linear_algebra.h"
#include "targets/shapes.h"
#include "targets/tags/quad.h"
#include "targets/tags/tag_family.h"
#include "targets/types/tag.h"

namespace plenocal {
namespace {

/// A plane through points, as a part's frame.
struct Plane {
  Eigen::Vector3d middle{0, 0, 0}, normal{0, 0, 0};  ///< the normal points to the viewer
};

struct Tag {
  int id = 0;
  std::array<Eigen::Vector3d, 4> corners;
  [[nodiscard]] Eigen::Vector3d Normal() const {
    return (corners[2] - corners[0]).cross(corners[3] - corners[1]).normalized();
  }
  [[nodiscard]] double Side() const { return (corners[1] - corners[0]).norm(); }
};

Plane FitPlane(const std::vector<Tag>& tags) {
  Plane plane;
  Eigen::Vector3d towards = Eigen::Vector3d::Zero();
  for (const Tag& tag : tags) {
    towards += tag.Normal();
    for (const Eigen::Vector3d& c : tag.corners) {
      plane.middle += c / (4.0 * static_cast<double>(tags.size()));
    }
  }
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Tag& tag : tags) {
    for (const Eigen::Vector3d& c : tag.corners) {
      scatter += (c - plane.middle) * (c - plane.middle).transpose();
    }
  }
  plane.normal = DecomposeSymmetric(scatter).vectors.col(0);
  if (plane.normal.dot(towards) < 0) plane.normal = -plane.normal;
  return plane;
}

/// Tags that lie in one plane, as far as tags glued to a board do.
std::vector<std::vector<Tag>> GroupByPlane(const std::vector<Tag>& tags) {
  constexpr double kTurn = 0.1;      // rad
  constexpr double kOffPlane = 0.2;  // of a tag's side
  std::vector<std::vector<Tag>> groups;
  for (const Tag& tag : tags) {
    const auto fits = [&](const std::vector<Tag>& group) {
      const Plane plane = FitPlane(group);
      return plane.normal.dot(tag.Normal()) > std::cos(kTurn) &&
             std::all_of(tag.corners.begin(), tag.corners.end(), [&](const Eigen::Vector3d& c) {
               return std::abs(plane.normal.dot(c - plane.middle)) < kOffPlane * tag.Side();
             });
    };
    const auto found = std::find_if(groups.begin(), groups.end(), fits);
    if (found == groups.end()) {
      groups.push_back({tag});
    } else {
      found->push_back(tag);
    }
  }
  return groups;
}

/// Upright: x along the target's axis that lies best in the plane, or, of a single tag, along its
/// own lower edge.
RigidTransform PartFrame(const std::vector<Tag>& tags) {
  const Plane plane = FitPlane(tags);
  Eigen::Vector3d right = tags[0].corners[1] - tags[0].corners[0];
  if (tags.size() > 1) {
    int axis = 0;
    for (int k = 1; k < 3; ++k) {
      if (std::abs(plane.normal[k]) < std::abs(plane.normal[axis]) - 0.1) axis = k;
    }
    right = Eigen::Vector3d::Unit(axis);
  }
  RigidTransform T;
  T.R.col(2) = -plane.normal;
  T.R.col(0) = (right - right.dot(plane.normal) * plane.normal).normalized();
  T.R.col(1) = T.R.col(2).cross(T.R.col(0));
  T.t = plane.middle;
  return T;
}

/// What all tags of a drawing share.
struct TagStyle {
  std::map<int, internal::TagPicture> pictures;  ///< by id
  bool corner_squares = false;                   ///< black squares touch the tags' corners
  double corner_square = 0;                      ///< m, their side
};

void DrawTag(const Tag& tag,
             const TagStyle& style,
             const RigidTransform& T_part_target,
             TargetPart* part) {
  DrawnTag drawn{.id = tag.id, .outline = {}, .paper = {}};
  internal::Quad quad;
  for (size_t k = 0; k < 4; ++k) quad[k] = (T_part_target * tag.corners[k]).head<2>();
  drawn.outline.assign(quad.begin(), quad.end());
  const Eigen::Matrix3d by_unit = internal::UnitSquareHomography(quad);
  const internal::TagPicture& picture = style.pictures.at(tag.id);
  const double outline = picture.width - 2 * picture.margin;  // cells
  // From cells, counted from the picture's upper left.
  const auto place = [&](const Eigen::Vector2d& cell) -> Eigen::Vector2d {
    const Eigen::Vector2d unit((cell.x() - picture.margin) / outline,
                               1 - (cell.y() - picture.margin) / outline);
    return (by_unit * unit.homogeneous()).hnormalized();
  };
  internal::AddCells(picture.white, picture.width, place, part);
  const double corner_cells = style.corner_square / tag.Side() * outline;
  if (style.corner_squares) {
    const double low = picture.margin, high = picture.margin + outline;
    for (const double x : {low - corner_cells, high}) {
      for (const double y : {low - corner_cells, high}) {
        Polygon square = internal::Rectangle(x, y, x + corner_cells, y + corner_cells);
        for (Eigen::Vector2d& p : square) p = place(p);
        part->black.push_back(std::move(square));
      }
    }
  }
  // Half of the gap; without neighbours the white bit that data outside of the outline needs.
  const double beyond = style.corner_squares ? corner_cells / 2 - picture.margin
                        : picture.margin > 1 ? 1
                                             : 0;
  drawn.paper =
      internal::Rectangle(-beyond, -beyond, picture.width + beyond, picture.width + beyond);
  for (Eigen::Vector2d& p : drawn.paper) {
    p = place(p);
    part->paper.extend(p);
  }
  part->finest = std::min(part->finest, tag.Side() / outline);
  part->tags.push_back(std::move(drawn));
}

TargetPart DrawTagPart(const std::vector<Tag>& tags, const TagStyle& style) {
  TargetPart part;
  part.T_target_part = PartFrame(tags);
  part.one_sheet = style.corner_squares;
  part.finest = std::numeric_limits<double>::infinity();
  const RigidTransform T_part_target = part.T_target_part.Inverse();
  for (const Tag& tag : tags) DrawTag(tag, style, T_part_target, &part);
  // Corner squares and their own white.
  if (style.corner_squares) {
    part.paper.extend((part.paper.min().array() - style.corner_square).matrix());
    part.paper.extend((part.paper.max().array() + style.corner_square).matrix());
  }
  return part;
}

/// Side of Kalibr's squares, m: they fill the crossings of the gaps between tags.
double CornerSquare(const std::vector<Tag>& tags) {
  constexpr double kUsualSpacing = 0.3;  // of Kalibr's targets, for a tag without neighbours
  double side = kUsualSpacing * tags[0].Side();
  double nearest = std::numeric_limits<double>::infinity();
  for (size_t i = 1; i < tags.size(); ++i) {
    const double away = (tags[i].corners[0] - tags[0].corners[0]).norm();
    if (away < nearest) nearest = away, side = away - tags[0].Side();
  }
  return side;
}

}  // namespace

std::vector<TargetPart> TagLayout::Draw(const MarkerPositions& markers, Pieces pieces) const {
  std::vector<Tag> tags;
  for (const int id : ids) {
    Tag tag{.id = id, .corners = {}};
    for (int k = 0; k < 4; ++k) tag.corners[static_cast<size_t>(k)] = markers.at(4 * id + k);
    tags.push_back(tag);
  }
  TagStyle style{.pictures = {}, .corner_squares = black_corner_squares};
  const internal::TagFamily codes = internal::MakeTagFamily(family, border_bits, ids);
  for (const int id : ids) style.pictures[id] = codes.Picture(id);
  if (black_corner_squares) style.corner_square = CornerSquare(tags);
  std::vector<std::vector<Tag>> groups;
  if (pieces == Pieces::kApart) {
    for (const Tag& tag : tags) groups.push_back({tag});
  } else {
    groups = GroupByPlane(tags);
  }
  std::vector<TargetPart> parts;
  parts.reserve(groups.size());
  for (const std::vector<Tag>& group : groups) {
    parts.push_back(DrawTagPart(group, style));
    parts.back().label = family;
  }
  return parts;
}

}  // namespace plenocal
