// SPDX-License-Identifier: Apache-2.0
#include "targets/types/charuco.h"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/aruco.hpp>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "targets/reading.h"
#include "targets/shapes.h"
#include "targets/target.h"

namespace plenocal {

Target CharucoLayout::Read(const YamlNode& node) {
  CharucoLayout board;
  board.columns = internal::ReadCount(node.At("columns"), 3);
  board.rows = internal::ReadCount(node.At("rows"), 3);
  board.square = internal::ReadPrintedLength(node.At("square"));
  board.marker = internal::ReadPrintedLength(node.At("marker"));
  if (board.marker >= board.square) {
    node.At("marker").Fail(
        fmt::format("expected less than the square's {}, got '{}'; both are sides in metres",
                    board.square,
                    board.marker));
  }
  const YamlNode dictionary_node = node.At("dictionary");
  const internal::CodeBook& dictionary = internal::ReadCodeBook(
      dictionary_node, internal::kArucoDictionaries, "a dictionary of OpenCV");
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
  target.markers =
      internal::PlaneMarkers(board.columns - 1, board.rows - 1, [&](int column, int row) {
        return Eigen::Vector2d((column + 1) * board.square, (row + 1) * board.square);
      });
  target.layout = std::move(board);
  return target;
}

namespace {

// Where a detector that expects `stated` finds the corners of the board `real`: each is measured
// beside one of the ArUco markers that it is expected to touch. Adds to `places`.
void AddMisreadCorners(const CharucoLayout& stated_board,
                       bool stated_legacy,
                       const std::vector<Eigen::Vector2i>& real,
                       CandidatePlaces* places) {
  const std::vector<Eigen::Vector2i> stated = internal::MarkedSquares(stated_board, stated_legacy);
  for (size_t id = 0; id < std::min(stated.size(), real.size()); ++id) {
    for (const Eigen::Vector2i& corner : {Eigen::Vector2i(0, 0),
                                          Eigen::Vector2i(1, 0),
                                          Eigen::Vector2i(1, 1),
                                          Eigen::Vector2i(0, 1)}) {
      const Eigen::Vector2i at = stated[id] + corner;  // inner corners count from 1
      if (at.minCoeff() < 1 || at.x() >= stated_board.columns || at.y() >= stated_board.rows) {
        continue;
      }
      std::vector<Eigen::Vector3d>& of_corner =
          (*places)[(at.y() - 1) * (stated_board.columns - 1) + at.x() - 1];
      const Eigen::Vector2d real_at = stated_board.square * (real[id] + corner).cast<double>();
      const Eigen::Vector3d place(real_at.x(), real_at.y(), 0);
      if (std::ranges::find(of_corner, place) == of_corner.end()) of_corner.push_back(place);
    }
  }
}

// The layouts that the detector of a board tries.
std::vector<bool> TriedLayouts(const CharucoLayout& board) {
  if (board.legacy) return {*board.legacy};
  return {false, true};
}

}  // namespace

TargetDoubts CharucoLayout::Doubts(const YamlNode& /*nominal*/) const {
  TargetDoubts doubts;
  if (legacy && rows % 2 == 0) {
    doubts.hypotheses.push_back(
        {.code = "target_legacy",
         .what = fmt::format("the board has OpenCV's {} layout", *legacy ? "new" : "legacy"),
         .remedy = fmt::format("set legacy: {}, or leave the key out", !*legacy),
         .places = [stated = *this] {
           CandidatePlaces places;
           const bool real = !*stated.legacy;
           AddMisreadCorners(stated, !real, internal::MarkedSquares(stated, real), &places);
           return places;
         }});
  }
  constexpr int kMostColumns = 20;  // of a board whose markers can still be read
  for (int other = 3; other <= kMostColumns; ++other) {
    if (other == columns) continue;
    CharucoLayout board = *this;
    board.columns = other;
    board.rows = std::max(3, (columns * rows + other - 1) / other);
    doubts.hypotheses.push_back(
        {.code = "target_layout",
         .what = fmt::format("the board has {} squares in a row, not {}", other, columns),
         .remedy = other == rows
                       ? fmt::format("set columns: {} and rows: {}", rows, columns)
                       : fmt::format("set columns: {} and the rows that go with it", other),
         .places = [stated = *this, board] {
           CandidatePlaces places;
           const auto real = internal::MarkedSquares(board, stated.legacy.value_or(false));
           for (const bool tried : TriedLayouts(stated)) {
             AddMisreadCorners(stated, tried, real, &places);
           }
           return places;
         }});
  }
  return doubts;
}

std::vector<TargetPart> CharucoLayout::Draw(const MarkerPositions& /*markers*/,
                                            Pieces /*pieces*/) const {
  TargetPart part;
  const double s = square;
  const internal::CharucoMarkers aruco = internal::DrawCharucoMarkers(*this);
  const Eigen::Vector2i first = aruco.markers.front().square;
  internal::AddSquares({columns, rows, 0, 0, s}, 1 - (first.x() + first.y()) % 2, &part);
  const double gap = (s - marker) / 2, cell = marker / aruco.width;
  for (const auto& drawn : aruco.markers) {
    internal::AddCells(
        drawn.white,
        aruco.width,
        [&](const Eigen::Vector2d& at) -> Eigen::Vector2d {
          return s * drawn.square.cast<double>() + Eigen::Vector2d(gap, gap) + cell * at;
        },
        &part);
  }
  part.squares = SquareGrid{columns - 1, rows - 1, s, s};
  part.paper = {Eigen::Vector2d(-0.5 * s, -0.5 * s),
                Eigen::Vector2d((columns + 0.5) * s, (rows + 0.5) * s)};
  part.finest = std::min(cell, gap);
  return {part};
}

namespace internal {

int ArucoDictionaryIndex(const std::string& name) {
  for (size_t i = 0; i < kArucoDictionaries.size(); ++i) {
    if (kArucoDictionaries[i].name == name) return static_cast<int>(i);
  }
  throw InputError(
      "dictionary: unknown name '{}'{}", name, SuggestName(name, NamesOf(kArucoDictionaries)));
}

std::vector<Eigen::Vector2i> MarkedSquares(const CharucoLayout& board, bool legacy) {
  const int parity = legacy && board.rows % 2 == 0 ? 0 : 1;  // of column + row
  std::vector<Eigen::Vector2i> squares;
  for (int row = 0; row < board.rows; ++row) {
    for (int column = 0; column < board.columns; ++column) {
      if ((row + column) % 2 == parity) squares.emplace_back(column, row);
    }
  }
  return squares;
}

CharucoMarkers DrawCharucoMarkers(const CharucoLayout& board) {
  // OpenCV 4.6 returns a pointer, its successors a dictionary.
  const cv::aruco::Dictionary dictionary(
      cv::aruco::getPredefinedDictionary(ArucoDictionaryIndex(board.dictionary)));
  const int bits = dictionary.markerSize;
  CharucoMarkers drawn{.width = bits + 2, .markers = {}};
  int id = 0;
  for (const Eigen::Vector2i& square : MarkedSquares(board, board.legacy.value_or(false))) {
    const cv::Mat code =
        cv::aruco::Dictionary::getBitsFromByteList(dictionary.bytesList.rowRange(id, id + 1), bits);
    ++id;
    CharucoMarkers::Marker marker{.square = square, .white = {}};
    for (int y = -1; y <= bits; ++y) {
      for (int x = -1; x <= bits; ++x) {
        const bool border = std::min(x, y) < 0 || std::max(x, y) == bits;
        marker.white.push_back(!border && code.at<uchar>(y, x) != 0);
      }
    }
    drawn.markers.push_back(std::move(marker));
  }
  return drawn;
}

}  // namespace internal

}  // namespace plenocal
