// SPDX-License-Identifier: Apache-2.0
//
// Tags are drawn by targets/types/tag_drawing.cc.
#include "targets/types/tag.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <memory>
#include <string>
#include <utility>

#include "calib/base/number_text.h"
#include "calib/camera/corner_orders.h"
#include "targets/plane_grid.h"
#include "targets/reading.h"
#include "targets/tags/tag_grid.h"

namespace plenocal {
namespace {

using internal::CheckTagId;
using internal::CodeBook;
using internal::ReadCount;
using internal::ReadPrintedLength;

const CodeBook& ReadFamily(const YamlNode& node) {
  return internal::ReadCodeBook(node, internal::kTagFamilies, "an AprilTag family");
}

int ReadBorderBits(const YamlNode& node, int otherwise) {
  if (!node.Has("border_bits")) return otherwise;
  const YamlNode bits = node.At("border_bits");
  const int value = bits.AsInteger();
  if (value != 1 && value != 2) {
    bits.Fail(fmt::format("expected 1, or 2 as Kalibr prints, got '{}'", value));
  }
  return value;
}

using Corners = std::array<Eigen::Vector3d, 4>;

// A convex quadrangle in any plane: its edges turn in the same direction at every corner.
bool IsQuadrangle(const Corners& corners) {
  const Eigen::Vector3d diagonal = corners[2] - corners[0];
  const Eigen::Vector3d other = corners[3] - corners[1];
  const Eigen::Vector3d normal = diagonal.cross(other);
  // Relative to the squared diagonals. Corners nearer to a line than this are taken to coincide or
  // to lie on it; of a real tag the ratio is near 0.1.
  constexpr double kFlat = 1e-6;
  const double area = diagonal.squaredNorm() + other.squaredNorm();
  for (size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d edge = corners[(k + 1) % 4] - corners[k];
    const Eigen::Vector3d next = corners[(k + 2) % 4] - corners[(k + 1) % 4];
    if (!(edge.cross(next).dot(normal) > kFlat * area * area)) return false;
  }
  return true;
}

Corners ReadCorners(const YamlNode& node, int id) {
  const std::vector<YamlNode> elements = node.Elements();
  Corners corners;
  if (elements.size() != corners.size()) {
    node.Fail(fmt::format(
        "expected 4 corners, got {}; write [[x, y, z], [x, y, z], [x, y, z], [x, y, z]]",
        elements.size()));
  }
  for (size_t k = 0; k < corners.size(); ++k) corners[k] = internal::ReadVector(elements[k]);
  if (!IsQuadrangle(corners)) {
    node.Fail(
        fmt::format("the corners of tag {} coincide, lie on a line or are crossed; write them "
                    "in the order lower left, lower right, upper right, upper left",
                    id));
  }
  return corners;
}

// The gap between tags in units of their side; a gap with its unit is a length.
double ReadGap(const YamlNode& node, double size) {
  const auto length = node.IsScalar() ? ParseLength(node.AsString()) : std::nullopt;
  if (length && length->has_unit) return ReadPrintedLength(node) / size;
  constexpr double kMost = 1000;
  const double gap = node.AsPositive();
  if (gap > kMost) {
    node.Fail(fmt::format("expected at most {} sizes of a tag, got '{}'; a length needs its unit",
                          kMost,
                          node.AsString()));
  }
  return gap;
}

}  // namespace

Target TagLayout::ReadTags(const YamlNode& node) {
  const CodeBook family = ReadFamily(node.At("family"));
  Target target;
  TagLayout layout;
  layout.family = family.name;
  layout.border_bits = ReadBorderBits(node, 1);
  const YamlNode tags = node.At("tags");
  const std::vector<std::string_view> keys = internal::KeyNames(kTagsKeys, "tags");
  std::map<int, int> line_of_id;
  for (const YamlNode& tag : tags.Elements()) {
    tag.CheckKeys(keys);
    const YamlNode id_node = tag.At("id");
    const int id = id_node.AsInteger();
    CheckTagId(id, family, id_node);
    const auto [first, is_new] = line_of_id.emplace(id, id_node.Line());
    if (!is_new) {
      id_node.Fail(fmt::format(
          "tag {} stands in line {} already; give every tag its own id", id, first->second));
    }
    const Corners corners = ReadCorners(tag.At("corners"), id);
    for (size_t k = 0; k < corners.size(); ++k) {
      target.markers[4 * id + static_cast<int>(k)] = corners[k];
    }
  }
  if (line_of_id.empty()) tags.Fail("expected at least one tag; write '- {id: 0, corners: ...}'");
  for (const auto& [id, line] : line_of_id) layout.ids.push_back(id);
  target.layout = std::move(layout);
  return target;
}

Target TagLayout::ReadGrid(const YamlNode& node) {
  const CodeBook family =
      node.Has("family") ? ReadFamily(node.At("family")) : internal::kDefaultFamily;
  internal::TagGrid grid;
  grid.columns = ReadCount(node.At("columns"), 1);
  grid.rows = ReadCount(node.At("rows"), 1);
  grid.size = ReadPrintedLength(node.At("size"));
  grid.spacing = ReadGap(node.At("spacing"), grid.size);
  if (node.Has("first_id")) grid.first_id = node.At("first_id").AsInteger();
  // The type is Kalibr's, so a file without the key is taken to describe Kalibr's print.
  return internal::TagGridTarget(
      grid, family, ReadBorderBits(node, 2), node.At(node.Has("first_id") ? "first_id" : "rows"));
}

namespace {

// The tags' corners in another order than the stated one.
void AddCornerOrders(const MarkerPositions& markers,
                     bool is_grid,
                     std::vector<TargetHypothesis>* hypotheses) {
  const auto shared = std::make_shared<const MarkerPositions>(markers);
  for (size_t i = 0; i < kCornerOrders.size(); ++i) {
    hypotheses->push_back(
        {.code = "target_corner_order",
         .what = fmt::format("the corners of each tag run {}", CornerOrderText(i)),
         .remedy = is_grid ? "number the detections' markers 4 * id + 0 lower left, 1 lower right, "
                             "2 upper right, 3 upper left of the upright tag"
                           : "write each tag's corners in the order lower left, lower right, upper "
                             "right, upper left of the upright tag",
         .places = [shared, order = kCornerOrders[i]] {
           CandidatePlaces places;
           for (const auto& [number, position] : *shared) {
             const int k = number % 4;
             const auto real = static_cast<int>(order[static_cast<size_t>(k)]);
             places[number] = {shared->at(number - k + real)};
           }
           return places;
         }});
  }
}

// A grid whose ids run in rows of `columns` from `first_id` on.
CandidatePlaces OtherGrid(const internal::TagGrid& stated, int columns, int first_id) {
  CandidatePlaces places;
  for (int i = 0; i < stated.columns * stated.rows; ++i) {
    const int id = stated.first_id + i, from = id - first_id;
    const int column = (from % columns + columns) % columns;
    const int row = (from - column) / columns;
    int number = 4 * id;
    for (const Eigen::Vector3d& corner : internal::TagCorners(stated, column, row)) {
      places[number++] = {corner};
    }
  }
  return places;
}

void AddGrids(const internal::TagGrid& stated, std::vector<TargetHypothesis>* hypotheses) {
  const int count = stated.columns * stated.rows;
  for (int columns = 1; columns <= std::min(count, internal::kMostColumns); ++columns) {
    if (columns == stated.columns) continue;
    hypotheses->push_back(
        {.code = "target_layout",
         .what = fmt::format("the ids run in rows of {} tags, not of {}", columns, stated.columns),
         .remedy = internal::ColumnsRemedy(columns, count),
         .places = [=] { return OtherGrid(stated, columns, stated.first_id); }});
  }
  for (int first = 1; first < stated.columns; ++first) {
    const int other = stated.first_id + first;
    hypotheses->push_back(
        {.code = "target_layout",
         .what = fmt::format("a row begins with tag {}, not with tag {}", other, stated.first_id),
         .remedy = fmt::format(
             "set first_id to the id of the board's lower left tag: {} or some rows later", other),
         .places = [=] { return OtherGrid(stated, stated.columns, other); }});
  }
}

TargetNumber GridSpacing(const internal::TagGrid& stated) {
  TargetNumber number{.code = "target_spacing",
                      .key = "spacing",
                      .meaning = "gap between tags / size",
                      .stated = stated.spacing,
                      .least = 0.01,
                      .most = 4,
                      .by_number = {}};
  for (int i = 0; i < stated.columns * stated.rows; ++i) {
    const Eigen::Vector3d slope(
        i % stated.columns * stated.size, static_cast<int>(i / stated.columns) * stated.size, 0);
    for (int k = 0; k < 4; ++k) number.by_number[4 * (stated.first_id + i) + k] = slope;
  }
  return number;
}

}  // namespace

TargetDoubts TagLayout::Doubts(const YamlNode& nominal) const {
  TargetDoubts doubts;
  const bool is_grid = nominal.Has("columns");
  const MarkerPositions markers = (is_grid ? ReadGrid(nominal) : ReadTags(nominal)).markers;
  AddCornerOrders(markers, is_grid, &doubts.hypotheses);
  if (!is_grid) return doubts;
  const internal::TagGrid stated{.columns = nominal.At("columns").AsInteger(),
                                 .rows = nominal.At("rows").AsInteger(),
                                 .size = nominal.At("size").AsLength(),
                                 .spacing = nominal.At("spacing").AsPositive(),
                                 .first_id = ids.front()};
  AddGrids(stated, &doubts.hypotheses);
  doubts.numbers.push_back(GridSpacing(stated));
  return doubts;
}

Eigen::Vector3d TagLayout::Normal(const MarkerPositions& markers, int marker) {
  const int first = marker - marker % 4;
  const Eigen::Vector3d diagonal = markers.at(first + 2) - markers.at(first);
  const Eigen::Vector3d other = markers.at(first + 3) - markers.at(first + 1);
  return diagonal.cross(other).normalized();
}

std::vector<MarkerQuad> TagLayout::Quads() const {
  std::vector<MarkerQuad> quads;
  quads.reserve(ids.size());
  for (const int id : ids) quads.push_back({4 * id, 4 * id + 1, 4 * id + 2, 4 * id + 3});
  return quads;
}

}  // namespace plenocal
