// SPDX-License-Identifier: Apache-2.0
//
// Kalibr's target files (github.com/ethz-asl/kalibr/wiki/calibration-targets). Their numbering is
// kept; where Kalibr lays x along the rows (checkerboard, symmetric circles) ours runs along the
// columns, as everywhere here, which is only another frame.
#include <fmt/format.h>

#include "calib/error.h"
#include "targets/target_reader.h"

namespace plenocal::internal {
namespace {

Target ReadAprilgrid(const YamlNode& node) {
  CheckTargetKeys(node,
                  {"target_type", "tagCols", "tagRows", "tagSize", "tagSpacing", "codeOffset"});
  TagGrid grid;
  grid.columns = ReadCount(node.At("tagCols"), 1);
  grid.rows = ReadCount(node.At("tagRows"), 1);
  grid.size = node.At("tagSize").AsLength();
  grid.spacing = node.At("tagSpacing").AsPositive();
  if (node.Has("codeOffset")) grid.first_id = node.At("codeOffset").AsInteger();
  constexpr int kBorderBits = 2;
  Target target = TagGridTarget(grid,
                                kDefaultFamily,
                                kBorderBits,
                                node.At(node.Has("codeOffset") ? "codeOffset" : "tagRows"));
  target.nominal_yaml = fmt::format(
      "plenocal: 1\ntype: aprilgrid\nfamily: {}\ncolumns: {}\nrows: {}\nsize: {}\nspacing: {}\n"
      "border_bits: {}\nfirst_id: {}\n",
      kDefaultFamily.name,
      grid.columns,
      grid.rows,
      grid.size,
      grid.spacing,
      kBorderBits,
      grid.first_id);
  return target;
}

Target ReadCheckerboard(const YamlNode& node) {
  CheckTargetKeys(
      node, {"target_type", "targetCols", "targetRows", "rowSpacingMeters", "colSpacingMeters"});
  ChessboardLayout board;
  board.columns = ReadCount(node.At("targetCols"), 2);
  board.rows = ReadCount(node.At("targetRows"), 2);
  board.square = node.At("rowSpacingMeters").AsLength();
  Target target;
  target.markers = MarkersOf(board, node.At("colSpacingMeters").AsLength());
  target.layout = board;
  target.nominal_yaml =
      fmt::format("plenocal: 1\ntype: chessboard\ncolumns: {}\nrows: {}\nsquare: {}\n",
                  board.columns,
                  board.rows,
                  board.square);
  return target;
}

Target ReadCirclegrid(const YamlNode& node) {
  CheckTargetKeys(node,
                  {"target_type", "targetCols", "targetRows", "spacingMeters", "asymmetricGrid"});
  CirclesLayout circles;
  circles.columns = ReadCount(node.At("targetCols"), 2);
  circles.rows = ReadCount(node.At("targetRows"), 2);
  circles.spacing = node.At("spacingMeters").AsLength();
  circles.asymmetric = node.Has("asymmetricGrid") && node.At("asymmetricGrid").AsBool();
  Target target;
  target.markers = MarkersOf(circles);
  target.layout = circles;
  target.nominal_yaml =
      fmt::format("plenocal: 1\ntype: circles\ncolumns: {}\nrows: {}\nspacing: {}\npattern: {}\n",
                  circles.columns,
                  circles.rows,
                  circles.spacing,
                  circles.asymmetric ? "asymmetric" : "symmetric");
  return target;
}

}  // namespace

Target ReadKalibrTarget(const YamlNode& node) {
  const YamlNode type = node.At("target_type");
  const std::string name = type.AsString();
  if (name == "aprilgrid") return ReadAprilgrid(node);
  if (name == "checkerboard") return ReadCheckerboard(node);
  if (name == "circlegrid") return ReadCirclegrid(node);
  constexpr std::string_view kTypes[] = {"aprilgrid", "checkerboard", "circlegrid"};
  type.Fail(
      fmt::format("expected a target type of Kalibr, got '{}'{}", name, SuggestName(name, kTypes)));
}

}  // namespace plenocal::internal
