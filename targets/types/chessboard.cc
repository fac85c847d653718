// SPDX-License-Identifier: Apache-2.0
#include "targets/types/chessboard.h"

#include "targets/reading.h"
#include "targets/shapes.h"
#include "targets/target.h"

namespace plenocal {

Target ChessboardLayout::Read(const YamlNode& node) {
  ChessboardLayout board;
  board.columns = internal::ReadCount(node.At("columns"), 2);
  board.rows = internal::ReadCount(node.At("rows"), 2);
  board.square = internal::ReadPrintedLength(node.At("square"));
  Target target;
  target.layout = board;
  target.markers = internal::PlaneMarkers(board.columns, board.rows, [&](int column, int row) {
    return Eigen::Vector2d(column * board.square, row * board.square);
  });
  return target;
}

TargetDoubts ChessboardLayout::Doubts(const YamlNode& /*nominal*/) const {
  return {.hypotheses = internal::OtherRows(
              columns,
              rows,
              "corners",
              [s = square](int column, int row) { return Eigen::Vector2d(column * s, row * s); }),
          .numbers = {},
          .quads = {}};
}

std::vector<TargetPart> ChessboardLayout::Draw(const MarkerPositions& /*markers*/,
                                               Pieces /*pieces*/) const {
  TargetPart part;
  const double s = square;
  // Marker 0 is the lower right corner of a black square, as on OpenCV's printed pattern.
  internal::AddSquares({columns + 1, rows + 1, -s, -s, s}, 0, &part);
  part.squares = SquareGrid{columns, rows, 0, s};
  part.paper = {Eigen::Vector2d(-1.5 * s, -1.5 * s),
                Eigen::Vector2d((columns + 0.5) * s, (rows + 0.5) * s)};
  part.finest = s;
  return {part};
}

}  // namespace plenocal
