// SPDX-License-Identifier: Apache-2.0
#include "detectors/target_drawing.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>
#include <variant>

#include "calib/error.h"
#include "detectors/charuco_looks.h"
#include "detectors/tag_looks.h"
#include "detectors/tag_template.h"

namespace plenocal {
namespace {

Polygon Rectangle(double x0, double y0, double x1, double y1) {
  return {{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}};
}

/// The black cells of a raster, as few rectangles: runs along rows. `place` maps cells to the part.
template <typename Place>
void AddCells(const std::vector<bool>& white, int width, const Place& place, TargetPart* part) {
  for (int y = 0; y < width; ++y) {
    const auto row = white.begin() + y * width;
    for (int x = 0; x < width;) {
      int end = x;
      while (end < width && !row[end]) ++end;
      if (end > x) {
        Polygon polygon = Rectangle(x, y, end, y + 1);
        for (Eigen::Vector2d& p : polygon) p = place(p);
        part->black.push_back(std::move(polygon));
      }
      x = std::max(end, x + 1);
    }
  }
}

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
  plane.normal = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter).eigenvectors().col(0);
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

TargetPart DrawTagPart(const std::vector<Tag>& tags,
                       const TagLayout& layout,
                       const std::map<int, internal::TagPicture>& pictures,
                       double corner_square) {
  TargetPart part;
  part.T_target_part = PartFrame(tags);
  part.one_sheet = layout.black_corner_squares;
  const RigidTransform T_part_target = part.T_target_part.Inverse();
  part.finest = std::numeric_limits<double>::infinity();
  for (const Tag& tag : tags) {
    DrawnTag drawn{.id = tag.id, .outline = {}, .paper = {}};
    internal::Quad quad;
    for (size_t k = 0; k < 4; ++k) quad[k] = (T_part_target * tag.corners[k]).head<2>();
    drawn.outline.assign(quad.begin(), quad.end());
    const Eigen::Matrix3d by_unit = internal::UnitSquareHomography(quad);
    const internal::TagPicture& picture = pictures.at(tag.id);
    const double outline = picture.width - 2 * picture.margin;
    // From cells, counted from the picture's upper left.
    const auto place = [&](const Eigen::Vector2d& cell) -> Eigen::Vector2d {
      const Eigen::Vector2d unit((cell.x() - picture.margin) / outline,
                                 1 - (cell.y() - picture.margin) / outline);
      return (by_unit * unit.homogeneous()).hnormalized();
    };
    AddCells(picture.white, picture.width, place, &part);
    if (layout.black_corner_squares) {
      const double cells = corner_square / tag.Side() * outline;
      const double low = picture.margin, high = picture.margin + outline;
      for (const double x : {low - cells, high}) {
        for (const double y : {low - cells, high}) {
          Polygon square = Rectangle(x, y, x + cells, y + cells);
          for (Eigen::Vector2d& p : square) p = place(p);
          part.black.push_back(std::move(square));
        }
      }
    }
    // Half of the gap; without neighbours the white bit that data outside of the outline needs.
    const double beyond = layout.black_corner_squares
                              ? corner_square / tag.Side() * outline / 2 - picture.margin
                          : picture.margin > 1 ? 1
                                               : 0;
    drawn.paper = Rectangle(-beyond, -beyond, picture.width + beyond, picture.width + beyond);
    for (Eigen::Vector2d& p : drawn.paper) {
      p = place(p);
      part.paper.extend(p);
    }
    part.finest = std::min(part.finest, tag.Side() / outline);
    part.tags.push_back(std::move(drawn));
  }
  // Corner squares and their own white.
  if (layout.black_corner_squares) {
    part.paper.extend((part.paper.min().array() - corner_square).matrix());
    part.paper.extend((part.paper.max().array() + corner_square).matrix());
  }
  return part;
}

std::vector<TargetPart> Draw(const Target& target, const TagLayout& layout, bool each_tag) {
  std::vector<Tag> tags;
  for (const int id : layout.ids) {
    Tag tag{.id = id, .corners = {}};
    for (int k = 0; k < 4; ++k) tag.corners[static_cast<size_t>(k)] = target.markers.at(4 * id + k);
    tags.push_back(tag);
  }
  // Kalibr's squares fill the crossings of the gaps between tags.
  double corner_square = 0;
  if (layout.black_corner_squares) {
    corner_square = 0.3 * tags[0].Side();  // Kalibr's usual spacing, where there is no gap to see
    double nearest = std::numeric_limits<double>::infinity();
    for (size_t i = 1; i < tags.size(); ++i) {
      const double away = (tags[i].corners[0] - tags[0].corners[0]).norm();
      if (away < nearest) nearest = away, corner_square = away - tags[0].Side();
    }
  }
  std::vector<std::vector<Tag>> groups;
  if (each_tag) {
    for (const Tag& tag : tags) groups.push_back({tag});
  } else {
    groups = GroupByPlane(tags);
  }
  const auto pictures = internal::DrawTags(target);
  std::vector<TargetPart> parts;
  parts.reserve(groups.size());
  for (const std::vector<Tag>& group : groups) {
    parts.push_back(DrawTagPart(group, layout, pictures, corner_square));
  }
  return parts;
}

/// The squares of the parity given, of a board whose first square's corner is (x0, y0).
void AddSquares(
    int columns, int rows, int parity, double x0, double y0, double square, TargetPart* part) {
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      if ((row + column) % 2 != parity) continue;
      const double x = x0 + column * square, y = y0 + row * square;
      part->black.push_back(Rectangle(x, y, x + square, y + square));
    }
  }
}

std::vector<TargetPart> Draw(const Target& /*target*/, const ChessboardLayout& board, bool) {
  TargetPart part;
  const double s = board.square;
  AddSquares(board.columns + 1, board.rows + 1, 0, -s, -s, s, &part);
  part.paper = {Eigen::Vector2d(-1.5 * s, -1.5 * s),
                Eigen::Vector2d((board.columns + 0.5) * s, (board.rows + 0.5) * s)};
  part.finest = s;
  return {part};
}

std::vector<TargetPart> Draw(const Target& /*target*/, const CharucoLayout& board, bool) {
  TargetPart part;
  const double s = board.square;
  const internal::CharucoLooks looks = internal::FindCharucoLooks(board);
  const Eigen::Vector2i first = looks.markers.front().square;
  AddSquares(board.columns, board.rows, 1 - (first.x() + first.y()) % 2, 0, 0, s, &part);
  const double gap = (s - board.marker) / 2, cell = board.marker / looks.width;
  for (const auto& marker : looks.markers) {
    AddCells(
        marker.white,
        looks.width,
        [&](const Eigen::Vector2d& at) -> Eigen::Vector2d {
          return s * marker.square.cast<double>() + Eigen::Vector2d(gap, gap) + cell * at;
        },
        &part);
  }
  part.paper = {Eigen::Vector2d(-0.5 * s, -0.5 * s),
                Eigen::Vector2d((board.columns + 0.5) * s, (board.rows + 0.5) * s)};
  part.finest = std::min(cell, gap);
  return {part};
}

std::vector<TargetPart> Draw(const Target& target, const CirclesLayout& circles, bool) {
  TargetPart part;
  const double radius = NominalRadius(circles);
  for (const auto& [number, position] : target.markers) {
    part.black_discs.push_back({position.head<2>(), radius});
    part.paper.extend(position.head<2>());
  }
  const Eigen::Vector2d margin = Eigen::Vector2d::Constant(4 * radius);
  part.paper = {Eigen::Vector2d(part.paper.min() - margin),
                Eigen::Vector2d(part.paper.max() + margin)};
  part.finest = radius;
  return {part};
}

std::vector<TargetPart> Draw(const Target& /*target*/, const MarkersLayout&, bool) {
  throw Error(ErrorKind::kInput,
              "a target of type 'markers' cannot be drawn: it does not say what its markers look "
              "like");
}

}  // namespace

double NominalRadius(const CirclesLayout& circles) {
  return circles.spacing * (circles.asymmetric ? std::sqrt(2.0) : 1) / 4;
}

std::vector<TargetPart> DrawTarget(const Target& target, bool each_tag) {
  return std::visit([&](const auto& layout) { return Draw(target, layout, each_tag); },
                    target.layout);
}

}  // namespace plenocal
