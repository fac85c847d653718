// SPDX-License-Identifier: Apache-2.0
#include "detectors/boards/marker_layout.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "calib/base/statistics.h"
#include "detectors/tag_assignment/tag_prediction.h"

// Neighbours in an image are neighbours on the board. Where one lies in the other's frame, in sides
// of a marker, is nearly the same in all images, and each layout (kind, number of columns) predicts
// it from the two ids, but for the pitch. All layouts are tried.

namespace plenocal::internal {
namespace {

/// Two markers that are near each other in some images.
struct Pair {
  int first = 0, second = 0;     ///< ids
  Eigen::Vector2d offset{0, 0};  ///< from the first to the second, marker sides, y down
  double images = 0;             ///< that show it
};

/// px a side of the marker along its x and y, in the middle.
Eigen::Matrix2d Axes(const Quad& q) {
  Eigen::Matrix2d axes;
  axes.col(0) = (q[1] - q[0] + q[2] - q[3]) / 2;
  axes.col(1) = (q[3] - q[0] + q[2] - q[1]) / 2;
  return axes;
}

std::vector<Pair> NearPairs(const std::vector<std::vector<NumberedSquare>>& images) {
  constexpr std::size_t kNearest = 8;
  std::map<std::pair<int, int>, std::pair<std::vector<double>, std::vector<double>>> offsets;
  for (const auto& squares : images) {
    for (const NumberedSquare& a : squares) {
      std::vector<std::pair<double, const NumberedSquare*>> others;
      for (const NumberedSquare& b : squares) {
        if (b.id != a.id)
          others.emplace_back((CentreOf(b.corners) - CentreOf(a.corners)).norm(), &b);
      }
      std::sort(others.begin(), others.end());
      // Of a small board the farther half are no neighbours.
      others.resize(std::min((others.size() + 1) / 2, kNearest));
      for (const auto& [distance, b] : others) {
        if (b->id < a.id) continue;
        // The mean of both frames is free of perspective to first order.
        const Eigen::Vector2d way = CentreOf(b->corners) - CentreOf(a.corners);
        const Eigen::Vector2d offset =
            (Axes(a.corners).inverse() * way + Axes(b->corners).inverse() * way) / 2;
        if (!offset.allFinite()) continue;
        auto& [xs, ys] = offsets[{a.id, b->id}];
        xs.push_back(offset.x());
        ys.push_back(offset.y());
      }
    }
  }
  std::vector<Pair> pairs;
  for (auto& [ids, xy] : offsets) {
    const auto count = static_cast<double>(xy.first.size());
    pairs.push_back({ids.first,
                     ids.second,
                     {Median(std::move(xy.first)), Median(std::move(xy.second))},
                     count});
  }
  return pairs;
}

/// Column and row (downwards) of a marker on a board of this kind.
class Places {
 public:
  /// `start`: id of any marker in column 0; of a ChArUco board the parity of column + row of its
  /// white squares.
  Places(MarkerLayout::Kind kind, int columns, int start)
      : kind_(kind), columns_(columns), start_(start) {}

  [[nodiscard]] Eigen::Vector2d At(int id) const {
    if (kind_ == MarkerLayout::Kind::kCharuco) return InWhiteSquares(id);
    const int column = ((id - start_) % columns_ + columns_) % columns_;
    const int row = (id - start_ - column) / columns_;
    return Eigen::Vector2d(column, kind_ == MarkerLayout::Kind::kRowsUp ? -row : row);
  }

 private:
  [[nodiscard]] Eigen::Vector2d InWhiteSquares(int id) const {
    // Two rows hold as many white squares as there are columns.
    const int twice = id / columns_, rest = id % columns_;
    const int in_first_row = (columns_ + (start_ == 0 ? 1 : 0)) / 2;
    const int row = rest < in_first_row ? 0 : 1;
    const int column = 2 * (row == 0 ? rest : rest - in_first_row) + (start_ + row) % 2;
    return Eigen::Vector2d(column, 2 * twice + row);
  }

  MarkerLayout::Kind kind_;
  int columns_, start_;
};

struct Fit {
  double pitch = 0;
  double agreeing = 0;  ///< pairs, weighted by their images
  int last_id = 0;      ///< of the agreeing
  int lowest_id = std::numeric_limits<int>::max();
};

Fit FitPitch(const std::vector<Pair>& pairs, const Places& places) {
  constexpr double kFarthest = 2.9;           // steps on the board: neighbours are no farther
  constexpr double kMisplaced = 0.35;         // steps
  constexpr double kLeast = 1.02, kMost = 6;  // marker sides: markers do not overlap
  std::vector<double> pitches;
  std::vector<std::pair<const Pair*, Eigen::Vector2d>> near;
  for (const Pair& pair : pairs) {
    const Eigen::Vector2d steps = places.At(pair.second) - places.At(pair.first);
    const double length = steps.norm();
    if (length == 0 || length > kFarthest) continue;
    near.emplace_back(&pair, steps);
    pitches.push_back(pair.offset.norm() / length);
  }
  Fit fit;
  fit.pitch = Median(std::move(pitches));
  if (fit.pitch < kLeast || fit.pitch > kMost) return fit;
  for (const auto& [pair, steps] : near) {
    if ((pair->offset / fit.pitch - steps).norm() > kMisplaced) continue;
    fit.agreeing += pair->images;
    fit.last_id = std::max(fit.last_id, pair->second);
    fit.lowest_id = std::min(fit.lowest_id, pair->first);
  }
  return fit;
}

MarkerLayout LayoutOf(MarkerLayout::Kind kind, int columns, int start, const Fit& fit) {
  MarkerLayout layout{.kind = kind, .columns = columns, .pitch = fit.pitch};
  if (kind == MarkerLayout::Kind::kCharuco) {
    layout.rows = static_cast<int>(Places(kind, columns, start).At(fit.last_id).y()) + 1;
    return layout;
  }
  const int column = ((fit.lowest_id - start) % columns + columns) % columns;
  layout.first_id = std::max(0, fit.lowest_id - column);
  layout.rows = (fit.last_id - layout.first_id) / columns + 1;
  return layout;
}

}  // namespace

std::optional<MarkerLayout> FindMarkerLayout(
    const std::vector<std::vector<NumberedSquare>>& images) {
  constexpr int kWidest = 40;
  constexpr double kLeastShare = 0.7;  // of the pairs: some are misread
  const std::vector<Pair> pairs = NearPairs(images);
  double all = 0;
  for (const Pair& pair : pairs) all += pair.images;
  std::optional<MarkerLayout> best;
  double most = 0;
  // In this order: of equally good ones the usual one, with few columns.
  for (const auto kind :
       {MarkerLayout::Kind::kRowsUp, MarkerLayout::Kind::kCharuco, MarkerLayout::Kind::kRowsDown}) {
    const bool charuco = kind == MarkerLayout::Kind::kCharuco;
    for (int columns = charuco ? 3 : 1; columns <= kWidest; ++columns) {
      for (int start = 0; start < (charuco ? 2 : columns); ++start) {
        const Fit fit = FitPitch(pairs, Places(kind, columns, start));
        if (fit.agreeing <= most) continue;
        most = fit.agreeing;
        best = LayoutOf(kind, columns, start, fit);
      }
    }
  }
  if (most < kLeastShare * all || most == 0) return std::nullopt;
  return best;
}

}  // namespace plenocal::internal
