// SPDX-License-Identifier: Apache-2.0
//
// Target type of OpenCV's ChArUco boards.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "targets/plane_grid.h"
#include "targets/target_type.h"

namespace plenocal {

/// OpenCV's ChArUco board. A marker's number is its ChArUco corner id: inner corners row by row, id
/// 0 nearest to the board's top left, at (square, square, 0), x right and y down. That is so in
/// OpenCV 4.6 (tried with Debian's 4.6.0) as in 4.7 and later.
///
/// OpenCV has drawn the board in two ways:
///
///   pattern  top-left square                    printed by
///   new      black                              OpenCV 4.6 and later
///   legacy   white, if the rows are even        OpenCV before; `setLegacyPattern(true)` since
///
/// In both, the ids of ArUco markers count the white squares row by row from the top left. With an
/// odd number of rows the patterns are the same.
struct CharucoLayout : internal::PlaneBoard {
  int columns = 0, rows = 0;   ///< squares
  double square = 0;           ///< m, side of a square
  double marker = 0;           ///< m, side of the ArUco markers
  std::string dictionary;      ///< OpenCV's name: "DICT_5X5_100"
  std::optional<bool> legacy;  ///< legacy pattern; not set: the image decides

  static Target Read(const YamlNode& node);
  static constexpr std::array kKeys{
      TargetKey{"columns", "", "squares in a row, 3 to 1000", ""},
      TargetKey{"rows", "", "squares in a column, 3 to 1000", ""},
      TargetKey{"square", "m", "side of a square", ""},
      TargetKey{"marker", "m", "side of an ArUco marker, less than `square`", ""},
      TargetKey{"dictionary", "", "OpenCV's dictionary of the markers, such as DICT_5X5_100", ""},
      TargetKey{"legacy",
                "",
                "true: OpenCV's legacy pattern (top-left square white if `rows` is even)",
                "the image decides"}};
  static constexpr std::array kTypes{
      TargetType{"charuco",
                 kKeys,
                 "columns: 7\nrows: 5\nsquare: 0.04\nmarker: 0.03\ndictionary: DICT_5X5_100\n",
                 Read,
                 "square:marker:dictionary"}};

  [[nodiscard]] TargetDoubts Doubts(const YamlNode& nominal) const;
  /// Without a statement of the file: the new pattern.
  [[nodiscard]] std::vector<TargetPart> Draw(const MarkerPositions& markers, Pieces pieces) const;
};

namespace internal {

/// Position of a dictionary in OpenCV's enumeration. Throws `Error` for an unknown name.
int ArucoDictionaryIndex(const std::string& name);

/// (column, row) of the white squares; the one at index i holds the ArUco marker with id i.
std::vector<Eigen::Vector2i> MarkedSquares(const CharucoLayout& board, bool legacy);

/// The ArUco markers in a board's white squares.
struct CharucoMarkers {
  int width = 0;  ///< of a marker with its black border, cells
  struct Marker {
    Eigen::Vector2i square;   ///< column, row
    std::vector<bool> white;  ///< width x width, row by row
  };
  std::vector<Marker> markers;  ///< by id
};

/// Without a statement of the file: of the new pattern.
CharucoMarkers DrawCharucoMarkers(const CharucoLayout& board);

}  // namespace internal

}  // namespace plenocal
