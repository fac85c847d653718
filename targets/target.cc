// SPDX-License-Identifier: Apache-2.0
#include "targets/target.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <charconv>
#include <utility>

#include "calib/error.h"
#include "calib/names.h"
#include "calib/yaml.h"
#include "targets/target_layouts.h"
#include "targets/target_reader.h"

namespace plenocal {
namespace internal {

int ReadCount(const YamlNode& node, int least) {
  constexpr int kMost = 1000;
  const int count = node.AsInteger();
  if (count < least || count > kMost) {
    node.Fail(fmt::format("expected a number from {} to {}, got '{}'; count them on the target",
                          least,
                          kMost,
                          count));
  }
  return count;
}

const CodeBook& ReadCodeBook(const YamlNode& node,
                             std::span<const CodeBook> books,
                             std::string_view what) {
  const std::string name = node.AsString();
  std::vector<std::string_view> names;
  for (const CodeBook& book : books) {
    if (book.name == name) return book;
    names.push_back(book.name);
  }
  node.Fail(fmt::format("expected {}, got '{}'{}", what, name, SuggestName(name, names)));
}

void CheckTargetKeys(const YamlNode& node, std::initializer_list<std::string_view> keys) {
  std::vector<std::string_view> known(keys);
  known.insert(known.end(), {"tolerance", "markers", "sigma"});
  node.CheckKeys(known);
}

// That tag `id` exists; otherwise nothing would ever detect it.
void CheckTagId(int id, const CodeBook& family, const YamlNode& node) {
  if (id >= 0 && id < family.size) return;
  node.Fail(fmt::format("expected an id of {}, 0 to {}, got {}; correct the id or the family",
                        family.name,
                        family.size - 1,
                        id));
}

Target TagGridTarget(const TagGrid& grid,
                     const CodeBook& family,
                     int border_bits,
                     const YamlNode& grid_node) {
  CheckTagId(grid.first_id, family, grid_node);
  CheckTagId(grid.first_id + grid.columns * grid.rows - 1, family, grid_node);
  Target target;
  target.layout = TagLayout{.family = std::string(family.name),
                            .border_bits = border_bits,
                            // Kalibr's way of printing: two bits of border and squares between.
                            .black_corner_squares = border_bits == 2,
                            .ids = TagIds(grid)};
  target.markers = MarkersOf(grid);
  return target;
}

}  // namespace internal

namespace {

using internal::CheckTagId;
using internal::CheckTargetKeys;
using internal::CodeBook;
using internal::kArucoDictionaries;
using internal::kTagFamilies;
using internal::Markers;
using internal::MarkersOf;
using internal::ReadCodeBook;
using internal::ReadCount;

Eigen::Vector3d ReadVector(const YamlNode& node) {
  const std::vector<double> numbers = node.AsNumbers(3);
  return {numbers[0], numbers[1], numbers[2]};
}

const CodeBook& ReadFamily(const YamlNode& node) {
  return ReadCodeBook(node, kTagFamilies, "an AprilTag family");
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

// A convex quadrangle, whatever its plane: every turn along its edges goes the way its diagonals
// say.
bool IsQuadrangle(const std::array<Eigen::Vector3d, 4>& corners) {
  const Eigen::Vector3d diagonal = corners[2] - corners[0];
  const Eigen::Vector3d other = corners[3] - corners[1];
  const Eigen::Vector3d normal = diagonal.cross(other);
  // Lengths below this part of the tag are none; real tags are far from it.
  constexpr double kFlat = 1e-6;
  const double area = diagonal.squaredNorm() + other.squaredNorm();
  for (size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d edge = corners[(k + 1) % 4] - corners[k];
    const Eigen::Vector3d next = corners[(k + 2) % 4] - corners[(k + 1) % 4];
    if (!(edge.cross(next).dot(normal) > kFlat * area * area)) return false;
  }
  return true;
}

Target ReadAprilTags(const YamlNode& node) {
  CheckTargetKeys(node, {"plenocal", "type", "family", "border_bits", "tags"});
  const CodeBook& family = ReadFamily(node.At("family"));
  Target target;
  TagLayout layout;
  layout.family = family.name;
  layout.border_bits = ReadBorderBits(node, 1);
  const YamlNode tags = node.At("tags");
  std::map<int, int> line_of_id;
  for (const YamlNode& tag : tags.Elements()) {
    tag.CheckKeys({"id", "corners"});
    const YamlNode id_node = tag.At("id");
    const int id = id_node.AsInteger();
    CheckTagId(id, family, id_node);
    const auto [first, is_new] = line_of_id.emplace(id, id_node.Line());
    if (!is_new) {
      id_node.Fail(fmt::format(
          "tag {} stands in line {} already; give every tag its own id", id, first->second));
    }
    const YamlNode corners_node = tag.At("corners");
    const std::vector<YamlNode> elements = corners_node.Elements();
    std::array<Eigen::Vector3d, 4> corners;
    if (elements.size() != corners.size()) {
      corners_node.Fail(fmt::format(
          "expected 4 corners, got {}; write [[x, y, z], [x, y, z], [x, y, z], [x, y, z]]",
          elements.size()));
    }
    for (size_t k = 0; k < corners.size(); ++k) {
      corners[k] = ReadVector(elements[k]);
      target.markers[4 * id + static_cast<int>(k)] = corners[k];
    }
    if (!IsQuadrangle(corners)) {
      corners_node.Fail(
          fmt::format("the corners of tag {} coincide, lie on a line or are crossed; write them "
                      "in the order lower left, lower right, upper right, upper left",
                      id));
    }
  }
  if (line_of_id.empty()) tags.Fail("expected at least one tag; write '- {id: 0, corners: ...}'");
  for (const auto& [id, line] : line_of_id) layout.ids.push_back(id);
  target.layout = std::move(layout);
  return target;
}

Target ReadAprilGrid(const YamlNode& node) {
  CheckTargetKeys(node,
                  {"plenocal",
                   "type",
                   "family",
                   "columns",
                   "rows",
                   "size",
                   "spacing",
                   "border_bits",
                   "first_id"});
  const CodeBook& family =
      node.Has("family") ? ReadFamily(node.At("family")) : internal::kDefaultFamily;
  internal::TagGrid grid;
  grid.columns = ReadCount(node.At("columns"), 1);
  grid.rows = ReadCount(node.At("rows"), 1);
  grid.size = node.At("size").AsLength();
  grid.spacing = node.At("spacing").AsPositive();
  if (node.Has("first_id")) grid.first_id = node.At("first_id").AsInteger();
  // The type is Kalibr's, so a file that does not say is taken to describe Kalibr's print.
  return internal::TagGridTarget(
      grid, family, ReadBorderBits(node, 2), node.At(node.Has("first_id") ? "first_id" : "rows"));
}

Target ReadChessboard(const YamlNode& node) {
  CheckTargetKeys(node, {"plenocal", "type", "columns", "rows", "square"});
  ChessboardLayout board;
  board.columns = ReadCount(node.At("columns"), 2);
  board.rows = ReadCount(node.At("rows"), 2);
  board.square = node.At("square").AsLength();
  Target target;
  target.layout = board;
  target.markers = MarkersOf(board, board.square);
  return target;
}

Target ReadCharuco(const YamlNode& node) {
  CheckTargetKeys(
      node, {"plenocal", "type", "columns", "rows", "square", "marker", "dictionary", "legacy"});
  CharucoLayout board;
  board.columns = ReadCount(node.At("columns"), 3);
  board.rows = ReadCount(node.At("rows"), 3);
  board.square = node.At("square").AsLength();
  board.marker = node.At("marker").AsLength();
  if (board.marker >= board.square) {
    node.At("marker").Fail(
        fmt::format("expected less than the square's {}, got '{}'; both are sides in metres",
                    board.square,
                    board.marker));
  }
  const YamlNode dictionary_node = node.At("dictionary");
  const CodeBook& dictionary =
      ReadCodeBook(dictionary_node, kArucoDictionaries, "a dictionary of OpenCV");
  board.dictionary = dictionary.name;
  const int needed = board.columns * board.rows / 2;
  if (needed > dictionary.size) {
    dictionary_node.Fail(
        fmt::format("expected a dictionary with the {} markers of the board, got '{}' with {}; "
                    "take a larger one or correct columns and rows",
                    needed,
                    dictionary.name,
                    dictionary.size));
  }
  if (node.Has("legacy")) board.legacy = node.At("legacy").AsBool();
  Target target;
  target.markers = MarkersOf(board);
  target.layout = std::move(board);
  return target;
}

Target ReadCircles(const YamlNode& node) {
  CheckTargetKeys(node, {"plenocal", "type", "columns", "rows", "spacing", "pattern"});
  CirclesLayout circles;
  circles.columns = ReadCount(node.At("columns"), 2);
  circles.rows = ReadCount(node.At("rows"), 2);
  circles.spacing = node.At("spacing").AsLength();
  const YamlNode pattern = node.At("pattern");
  circles.asymmetric = pattern.AsString() == "asymmetric";
  if (!circles.asymmetric && pattern.AsString() != "symmetric") {
    constexpr std::string_view kPatterns[] = {"symmetric", "asymmetric"};
    pattern.Fail(fmt::format("expected symmetric or asymmetric, got '{}'{}",
                             pattern.AsString(),
                             SuggestName(pattern.AsString(), kPatterns)));
  }
  Target target;
  target.layout = circles;
  target.markers = MarkersOf(circles);
  return target;
}

// Its positions come from `markers`, as the refined ones of every type.
Target ReadMarkersOnly(const YamlNode& node) {
  CheckTargetKeys(node, {"plenocal", "type"});
  Target target;
  target.layout = MarkersLayout{};
  return target;
}

struct TargetType {
  std::string_view name;
  Target (*read)(const YamlNode& node);
};
constexpr std::array kTypes = {TargetType{"apriltag", ReadAprilTags},
                               TargetType{"aprilgrid", ReadAprilGrid},
                               TargetType{"chessboard", ReadChessboard},
                               TargetType{"charuco", ReadCharuco},
                               TargetType{"circles", ReadCircles},
                               TargetType{"markers", ReadMarkersOnly}};

// Layout and nominal positions of our own file; of type `markers` the layout alone.
Target ReadNominal(const YamlNode& node) {
  node.CheckVersion();
  const YamlNode type_node = node.At("type");
  const std::string name = type_node.AsString();
  for (const TargetType& type : kTypes) {
    if (type.name == name) return type.read(node);
  }
  type_node.Fail(
      fmt::format("expected a target type, got '{}'{}", name, SuggestName(name, TargetTypes())));
}

// The entries of `markers` or `sigma`.
std::map<int, std::pair<Eigen::Vector3d, YamlNode>> ReadNumbered(const YamlNode& node) {
  std::map<int, std::pair<Eigen::Vector3d, YamlNode>> numbered;
  for (const auto& [key, value] : node.Entries()) {
    int number = -1;
    const auto [end, error] = std::from_chars(key.data(), key.data() + key.size(), number);
    if (error != std::errc() || end != key.data() + key.size() || number < 0) {
      value.Fail("expected a marker's number as key; write 'number: [x, y, z]'");
    }
    const auto [first, is_new] = numbered.emplace(number, std::pair(ReadVector(value), value));
    if (!is_new) {
      value.Fail(fmt::format("marker {} stands in line {} already; remove one of the two",
                             number,
                             first->second.second.Line()));
    }
  }
  return numbered;
}

void ReadRefinement(const YamlNode& node, Target* target) {
  const bool numbers_are_free = std::holds_alternative<MarkersLayout>(target->layout);
  if (node.Has("markers") || numbers_are_free) {
    const YamlNode markers = node.At("markers");
    for (const auto& [number, entry] : ReadNumbered(markers)) {
      if (!numbers_are_free && !target->markers.contains(number)) {
        entry.second.Fail("this target has no such marker; remove it or correct the number");
      }
      target->markers[number] = entry.first;
    }
    if (target->markers.empty()) markers.Fail("expected markers; write 'number: [x, y, z]' lines");
  }
  if (!node.Has("sigma")) return;
  const YamlNode sigma = node.At("sigma");
  for (const auto& [number, entry] : ReadNumbered(sigma)) {
    if (!node.Has("markers") || !node.At("markers").Has(fmt::format("{}", number))) {
      entry.second.Fail("a sigma needs its marker; add the number to 'markers' or remove it here");
    }
    if (entry.first.minCoeff() < 0) {
      entry.second.Fail("expected standard deviations in metres, got a negative number");
    }
  }
}

}  // namespace

std::vector<std::string_view> TargetTypes() { return NamesOf(kTypes); }

Target ReadTarget(const std::filesystem::path& path) {
  return ReadTarget(YamlNode::ReadFile(path));
}

Target ReadTarget(const YamlNode& node) {
  Target target;
  if (!node.Has("plenocal") && node.Has("target_type")) {
    target = internal::ReadKalibrTarget(node);
  } else {
    target = ReadNominal(node);
    // The version stands first in every file, wherever the user wrote it.
    target.nominal_yaml = "plenocal: 1\n" + node.Dump({"plenocal", "markers", "sigma"});
  }
  if (node.Has("tolerance")) {
    target.tolerance = node.At("tolerance").AsLength();
    if (node.Has("target_type")) {
      target.nominal_yaml += fmt::format("tolerance: {}\n", *target.tolerance);
    }
  }
  ReadRefinement(node, &target);
  return target;
}

Target NominalTarget(const Target& target) {
  Target nominal = target;
  if (!std::holds_alternative<MarkersLayout>(target.layout)) {
    nominal.markers = ReadNominal(YamlNode::Parse(target.nominal_yaml, "target")).markers;
  }
  return nominal;
}

std::string RefinedTargetYaml(const Target& target,
                              const std::map<int, Eigen::Vector3d>& positions,
                              const std::map<int, Eigen::Vector3d>& sigmas) {
  const auto line = [](int number, const Eigen::Vector3d& v) {
    return fmt::format("  {}: [{:.12g}, {:.12g}, {:.12g}]\n", number, v.x(), v.y(), v.z());
  };
  const Markers nominal = ReadNominal(YamlNode::Parse(target.nominal_yaml, "target")).markers;
  std::string markers_yaml, sigma_yaml;
  for (const auto& [number, place] : target.markers) {
    const auto refined = positions.find(number);
    if (refined != positions.end()) {
      markers_yaml += line(number, refined->second);
      const auto sigma = sigmas.find(number);
      if (sigma != sigmas.end()) sigma_yaml += line(number, sigma->second);
      continue;
    }
    // Not refined now, but by an earlier calibration: only `markers` can say so.
    const auto at = nominal.find(number);
    if (at == nominal.end() || at->second != place) markers_yaml += line(number, place);
  }
  std::string yaml = target.nominal_yaml;
  if (!markers_yaml.empty()) yaml += "markers:\n" + markers_yaml;
  if (!sigma_yaml.empty()) yaml += "sigma:\n" + sigma_yaml;
  return yaml;
}

}  // namespace plenocal
