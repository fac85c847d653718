// SPDX-License-Identifier: Apache-2.0
#include "detectors/boards/chessboard_detector.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "detectors/boards/corner_lattice.h"
#include "detectors/boards/grid_order.h"
#include "detectors/templates/board_templates.h"
#include "detectors/templates/saddle.h"

// Which corner is number 0. The inner corners' lattice (columns x rows) is symmetric under a turn
// by 180 degrees, a square one by 90; the colours may distinguish the places. The rule is that the
// outer square at corner 0 is black, as on OpenCV's printed pattern:
//
//   columns + rows odd              always decided: the squares at opposite ends differ in colour
//   columns = rows, both odd        decided up to 180 degrees
//   otherwise                       the colours are the same after every turn
//
// Where more than one place remains, the corner nearest the image's top left is 0. One image cannot
// decide more: cameras of a rig, or frames, that see such a board rotated by more than 90 degrees
// against each other may each begin at another end. A board with columns + rows odd avoids
// it.

namespace plenocal {
namespace {

using internal::CornerGrid;
using internal::CornerLattice;
using internal::GridOrder;
using internal::Saddle;

class ChessboardDetector final : public MarkerDetector {
 public:
  ChessboardDetector(const ChessboardLayout& layout, const OtherTargets& others)
      : columns_(layout.columns),
        rows_(layout.rows),
        larger_(internal::LargerGrids(layout, others)) {}

  MarkerDetections Detect(const cv::Mat& gray) override {
    MarkerDetections found;
    constexpr int kMinPixelsPerSquare = 3;
    if (std::max(gray.cols, gray.rows) < kMinPixelsPerSquare * std::max(columns_, rows_) ||
        std::min(gray.cols, gray.rows) < kMinPixelsPerSquare * std::min(columns_, rows_)) {
      found.failure = fmt::format("{} x {} pixels are too few for a {} x {} chessboard",
                                  gray.cols,
                                  gray.rows,
                                  columns_,
                                  rows_);
      return found;
    }
    const int count = columns_ * rows_;
    if (larger_.empty()) {
      found = Choose(gray, internal::FindLargeCornerLattices(gray, count));
      if (std::ssize(found.markers) == count) return found;
    }
    return Choose(gray, internal::FindCornerLattices(gray, count / 2));
  }

 private:
  /// Measures the board where all its corners are clear, else where most are.
  [[nodiscard]] MarkerDetections Choose(const cv::Mat& gray,
                                        std::vector<CornerLattice> lattices) const {
    MarkerDetections found;
    found.failure = fmt::format(
        "no {} x {} chessboard found (inner corners): only part of it is visible, or it is too "
        "blurred, too small or unevenly lit",
        columns_,
        rows_);
    std::size_t largest = 0;  // of the lattices that are, or may be, another board's or part of one
    const bool may_be_part = !AllIn(larger_, lattices);
    for (CornerLattice& lattice : lattices) {
      if (lattice.columns != columns_) lattice = internal::Transposed(lattice);
      if (lattice.columns != columns_ || lattice.rows != rows_) {
        if (!found.markers.empty() || lattice.corners.size() <= largest) continue;
        largest = lattice.corners.size();
        found.failure = fmt::format(
            "{} x {} inner corners of a chessboard found instead of {} x {}: only part of it is "
            "visible, or the target's columns and rows are not this board's",
            lattice.columns,
            lattice.rows,
            columns_,
            rows_);
        continue;
      }
      if (may_be_part &&
          internal::MayGoOnOutside(
              internal::NextPlaces(lattice.corners, columns_), gray.cols, gray.rows)) {
        if (found.markers.empty()) {
          largest = lattice.corners.size();
          found.failure = fmt::format(
              "a {} x {} chessboard (inner corners) was found at the image's border; it may be part "
              "of another target's larger board",
              columns_,
              rows_);
        }
        continue;
      }
      // A scale where some corners are too faint or blurred may do for the others.
      MarkerDetections refined = Refine(gray, lattice.corners);
      if (refined.markers.size() > found.markers.size() || found.markers.empty()) {
        found = std::move(refined);
      }
      if (found.markers.size() == lattice.corners.size()) break;
    }
    return found;
  }

  /// Whether each of these boards is among the lattices.
  static bool AllIn(const std::vector<cv::Size>& boards,
                    const std::vector<CornerLattice>& lattices) {
    return std::ranges::all_of(boards, [&](const cv::Size& board) {
      return std::ranges::any_of(lattices, [&](const CornerLattice& lattice) {
        return std::minmax(lattice.columns, lattice.rows) == std::minmax(board.width, board.height);
      });
    });
  }

  /// Measures the corners and numbers them; `failure` when they are not a chessboard's.
  [[nodiscard]] MarkerDetections Refine(const cv::Mat& gray,
                                        const std::vector<Eigen::Vector2d>& points) const {
    const std::vector<std::optional<Eigen::Vector2d>> guesses(points.begin(), points.end());
    const CornerGrid grid = internal::RefineGrid(gray, columns_, rows_, guesses);

    // On a chessboard the contrast alternates from corner to corner.
    int refined = 0, even_bright = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (!grid.corners[i]) continue;
      ++refined;
      even_bright += IsEven(i) == (grid.corners[i]->contrast > 0) ? 1 : 0;
    }
    MarkerDetections found;
    const auto count = static_cast<int>(points.size());
    const bool bright = 2 * even_bright > refined;
    const int agreeing = bright ? even_bright : refined - even_bright;
    if (agreeing < refined || 2 * refined < count) {
      found.failure = fmt::format(
          "a pattern of {} x {} places was found, but only {} of them look like corners of a "
          "chessboard: the board is too blurred, too small or partly hidden",
          columns_,
          rows_,
          agreeing);
      return found;
    }

    const GridOrder order = Canonical(points, bright);
    for (int marker = 0; marker < count; ++marker) {
      const std::optional<Saddle>& corner = grid.corners[order[marker]];
      if (!corner) {
        found.left_out.push_back(fmt::format(
            "corner {}: no clear crossing of edges there (hidden, blurred or a reflection)",
            marker));
        continue;
      }
      found.markers.push_back({.marker = marker,
                               .values = {corner->p.x(), corner->p.y()},
                               .detector_sigma = corner->sigma});
    }
    return found;
  }

  [[nodiscard]] bool IsEven(std::size_t index) const {
    return (index / columns_ + index % columns_) % 2 == 0;
  }

  /// `bright`: the outer square at the first point found is bright. (Mirroring a row swaps the
  /// quadrants and, with an even number of columns, the parity.)
  [[nodiscard]] GridOrder Canonical(const std::vector<Eigen::Vector2d>& points, bool bright) const {
    GridOrder found = internal::FoundOrder(columns_, rows_);
    bool first_bright = bright;
    if (internal::Handedness(points, found, columns_) < 0) {
      found = internal::RowsReversed(found, columns_);
      if (columns_ % 2 != 0) first_bright = !first_bright;
    }
    struct Turn {
      GridOrder order;
      bool bright;
    };
    const bool other_end_differs = (columns_ + rows_) % 2 != 0;
    std::vector<Turn> turns{{found, first_bright},
                            {internal::Rotated180(found), first_bright != other_end_differs}};
    if (columns_ == rows_) {
      // A quarter turn swaps the quadrants, and with an even size the parity too.
      const bool turned_bright = first_bright != (rows_ % 2 != 0);
      const GridOrder turned = internal::Rotated90(found, rows_);
      turns.push_back({turned, turned_bright});
      turns.push_back({internal::Rotated180(turned), turned_bright});
    }
    std::vector<GridOrder> black, any;
    for (const Turn& turn : turns) {
      any.push_back(turn.order);
      if (!turn.bright) black.push_back(turn.order);
    }
    return internal::NearestTopLeft(points, black.empty() ? any : black);
  }

  int columns_, rows_;
  std::vector<cv::Size> larger_;  // others of which this board may be a part
};

}  // namespace

std::unique_ptr<MarkerDetector> MakeDetector(const ChessboardLayout& layout,
                                             const Target& /*target*/,
                                             const OtherTargets& others) {
  return std::make_unique<ChessboardDetector>(layout, others);
}

std::vector<internal::MarkerTemplate> internal::MakeTemplates(
    const ChessboardLayout& layout,
    const Target& /*target*/,
    const std::vector<Observation>& found) {
  constexpr int kSquares = 6;  // of the pattern around a corner
  const auto draw = [](int /*column*/, int /*row*/) {
    std::vector<float> cells;
    cells.reserve(kSquares * kSquares);
    for (int i = 0; i < kSquares * kSquares; ++i) {
      cells.push_back((i / kSquares + i % kSquares) % 2 == 0 ? 1.f : -1.f);
    }
    return CellTemplate(std::move(cells), kSquares);
  };
  return CornerTemplates(layout.columns, found, kSquares, draw);
}

}  // namespace plenocal
