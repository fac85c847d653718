// SPDX-License-Identifier: Apache-2.0
//
// Parts of the target types whose markers are a grid in a plane.
#pragma once

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "targets/target_type.h"

namespace plenocal::internal {

/// The parts of a target type (`IsTargetLayout`) that boards share: one flat part in the plane z =
/// 0, whose y axis points down.
struct PlaneBoard {
  static constexpr bool kHasNominalMarkers = true;
  [[nodiscard]] static int Part(int /*marker*/) { return 0; }
  [[nodiscard]] static Eigen::Vector3d Normal(const MarkerPositions& /*markers*/, int /*marker*/) {
    return {0, 0, -1};
  }
  [[nodiscard]] static std::vector<MarkerQuad> Quads() { return {}; }
};

/// Markers in the plane z = 0, numbered row by row; `position(column, row)` is their x and y.
template <typename Position>
MarkerPositions PlaneMarkers(int columns, int rows, Position position) {
  MarkerPositions markers;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const Eigen::Vector2d xy = position(column, row);
      markers.emplace_hint(
          markers.end(), row * columns + column, Eigen::Vector3d(xy.x(), xy.y(), 0));
    }
  }
  return markers;
}

inline constexpr int kMostColumns = 60;  // longer rows are not printed

/// For a grid of `count` points or tags that has another number of columns than is stated.
inline std::string ColumnsRemedy(int columns, int count) {
  return fmt::format("set columns: {} and {}",
                     columns,
                     count % columns == 0 ? fmt::format("rows: {}", count / columns)
                                          : std::string("the rows that go with it"));
}

/// A grid whose numbers run in rows of another length than `columns`; `position` and `markers` as
/// of `PlaneMarkers`; hypotheses keep copies of `position`. `what` is what is numbered ("corners").
template <typename Position>
std::vector<TargetHypothesis> OtherRows(int columns,
                                        int rows,
                                        std::string_view what,
                                        Position position) {
  const int count = columns * rows;
  std::vector<TargetHypothesis> hypotheses;
  for (int other = 2; other <= std::min(count / 2, kMostColumns); ++other) {
    if (other == columns) continue;
    hypotheses.push_back(
        {.code = "target_layout",
         .what = fmt::format("the {} are numbered in rows of {}, not of {}", what, other, columns),
         .remedy = ColumnsRemedy(other, count),
         .places = [=] {
           CandidatePlaces places;
           for (int i = 0; i < count; ++i) {
             const Eigen::Vector2d xy = position(i % other, i / other);
             places.emplace_hint(
                 places.end(), i, CandidatePlaces::mapped_type{{xy.x(), xy.y(), 0}});
           }
           return places;
         }});
  }
  return hypotheses;
}

}  // namespace plenocal::internal
