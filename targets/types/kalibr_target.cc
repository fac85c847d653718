// SPDX-License-Identifier: Apache-2.0
//
// Kalibr's target files (github.com/ethz-asl/kalibr/wiki/calibration-targets). Their numbering is
// kept; where Kalibr lays x along the rows (checkerboard, symmetric circles) ours runs along the
// columns, as everywhere here, which is only another frame.
#include <fmt/format.h>

#include <array>

#include "targets/plane_grid.h"
#include "targets/reading.h"
#include "targets/tags/tag_grid.h"
#include "targets/target.h"

namespace plenocal {
namespace {

using internal::kDefaultFamily;
using internal::ReadCount;
using internal::ReadPrintedLength;
using internal::TagGrid;

constexpr std::array kAprilgridKeys{
    TargetKey{"tagCols", "", "tags in a row, 1 to 1000", ""},
    TargetKey{"tagRows", "", "tags in a column, 1 to 1000", ""},
    TargetKey{"tagSize", "m", "side of a tag's black border", ""},
    TargetKey{"tagSpacing", "", "gap between tags / tagSize", ""},
    TargetKey{"codeOffset", "", "number of the lower left tag", "0"}};

Target ReadAprilgrid(const YamlNode& node) {
  TagGrid grid;
  grid.columns = ReadCount(node.At("tagCols"), 1);
  grid.rows = ReadCount(node.At("tagRows"), 1);
  grid.size = ReadPrintedLength(node.At("tagSize"));
  grid.spacing = node.At("tagSpacing").AsPositive();
  if (node.Has("codeOffset")) grid.first_id = node.At("codeOffset").AsInteger();
  constexpr int kBorderBits = 2;
  Target target =
      internal::TagGridTarget(grid,
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

constexpr std::array kCheckerboardKeys{
    TargetKey{"targetCols", "", "inner corners in a row, 2 to 1000", ""},
    TargetKey{"targetRows", "", "inner corners in a column, 2 to 1000", ""},
    TargetKey{"rowSpacingMeters", "m", "distance between rows", ""},
    TargetKey{"colSpacingMeters", "m", "distance between columns", ""}};

Target ReadCheckerboard(const YamlNode& node) {
  ChessboardLayout board;
  board.columns = ReadCount(node.At("targetCols"), 2);
  board.rows = ReadCount(node.At("targetRows"), 2);
  board.square = ReadPrintedLength(node.At("rowSpacingMeters"));
  const double column_spacing = ReadPrintedLength(node.At("colSpacingMeters"));
  Target target;
  target.markers = internal::PlaneMarkers(board.columns, board.rows, [&](int column, int row) {
    return Eigen::Vector2d(column * column_spacing, row * board.square);
  });
  target.layout = board;
  if (column_spacing != board.square) target.unequal = target.markers;
  target.nominal_yaml =
      fmt::format("plenocal: 1\ntype: chessboard\ncolumns: {}\nrows: {}\nsquare: {}\n",
                  board.columns,
                  board.rows,
                  board.square);
  return target;
}

constexpr std::array kCirclegridKeys{TargetKey{"targetCols", "", "circles in a row, 2 to 1000", ""},
                                     TargetKey{"targetRows", "", "rows of circles, 2 to 1000", ""},
                                     TargetKey{"spacingMeters", "m", "distance between rows", ""},
                                     TargetKey{"asymmetricGrid", "", "True or False", "False"}};

Target ReadCirclegrid(const YamlNode& node) {
  CirclesLayout circles;
  circles.columns = ReadCount(node.At("targetCols"), 2);
  circles.rows = ReadCount(node.At("targetRows"), 2);
  circles.spacing = ReadPrintedLength(node.At("spacingMeters"));
  circles.asymmetric = node.Has("asymmetricGrid") && node.At("asymmetricGrid").AsBool();
  Target target;
  target.markers = internal::CirclePositions(circles);
  target.layout = circles;
  target.nominal_yaml =
      fmt::format("plenocal: 1\ntype: circles\ncolumns: {}\nrows: {}\nspacing: {}\npattern: {}\n",
                  circles.columns,
                  circles.rows,
                  circles.spacing,
                  circles.asymmetric ? "asymmetric" : "symmetric");
  return target;
}

constexpr std::array kTypes{
    TargetType{"aprilgrid",
               kAprilgridKeys,
               "tagCols: 6\ntagRows: 5\ntagSize: 0.088\ntagSpacing: 0.3\n",
               ReadAprilgrid},
    TargetType{"checkerboard",
               kCheckerboardKeys,
               "targetCols: 6\ntargetRows: 7\nrowSpacingMeters: 0.06\ncolSpacingMeters: 0.05\n",
               ReadCheckerboard},
    TargetType{"circlegrid",
               kCirclegridKeys,
               "targetCols: 6\ntargetRows: 7\nspacingMeters: 0.02\nasymmetricGrid: False\n",
               ReadCirclegrid}};

}  // namespace

std::span<const TargetType> KalibrTargetTypes() { return kTypes; }

}  // namespace plenocal
