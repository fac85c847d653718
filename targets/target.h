// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "calib/yaml.h"

namespace plenocal {

/// Tags of the AprilTag library: a free arrangement in 3D or a regular grid. A tag's corners are
/// the markers 4 * id + k, k counting lower left, lower right, upper right, upper left of the
/// upright tag, at the outer edge of its black border.
struct TagLayout {
  std::string family;                 ///< as the AprilTag library names it: "tag36h11"
  int border_bits = 1;                ///< width of the black border; Kalibr prints 2
  bool black_corner_squares = false;  ///< Kalibr's grids: black squares touch the tags' corners
  std::vector<int> ids;               ///< the tags that are on the target, ascending
};

/// Inner corners of a chessboard; marker row * columns + column.
struct ChessboardLayout {
  int columns = 0, rows = 0;
  double square = 0;  ///< m
};

/// OpenCV's ChArUco board; a marker's number is its ChArUco corner id: inner corners row by row, id
/// 0 nearest to the board's top left, at (square, square, 0), x right and y down. That is so in
/// OpenCV 4.6 (tried with Debian's 4.6.0) as in 4.7 and later.
struct CharucoLayout {
  int columns = 0, rows = 0;  ///< squares
  double square = 0;          ///< m
  double marker = 0;          ///< m, side of the ArUco markers
  std::string dictionary;     ///< OpenCV's name: "DICT_5X5_100"
  /// OpenCV's legacy pattern (printed before 4.6: white square top left when `rows` is even); not
  /// set: the image decides.
  std::optional<bool> legacy;
};

/// Circle grid; marker row * columns + column.
struct CirclesLayout {
  int columns = 0, rows = 0;
  double spacing = 0;  ///< m
  bool asymmetric = false;
};

/// Markers without a detector: their observations come from files.
struct MarkersLayout {};

using TargetLayout =
    std::variant<TagLayout, ChessboardLayout, CharucoLayout, CirclesLayout, MarkersLayout>;

/// A calibration target: what a detector must look for and where each marker is.
struct Target {
  TargetLayout layout;
  /// Marker number -> position in the target's frame, m. Refined positions where the file has them.
  std::map<int, Eigen::Vector3d> markers;
  /// Standard deviation of each nominal marker coordinate, m; empty when the file states none.
  std::optional<double> tolerance;
  /// The file's own keys without `markers` and `sigma` of a refinement, as YAML lines, so that a
  /// refined target keeps them. For Kalibr's file: the equivalent keys of ours.
  std::string nominal_yaml;
};

/// Names of all target types, as in the file's `type`.
std::vector<std::string_view> TargetTypes();

/// Reads target.yaml of any type, or Kalibr's own target file (`target_type: aprilgrid`,
/// `checkerboard` or `circlegrid`). Throws `Error` with file, line and key.
Target ReadTarget(const std::filesystem::path& path);
/// The same of a file's root node.
Target ReadTarget(const YamlNode& node);

/// The target without its refinement: markers where the nominal keys put them. A target of type
/// `markers` has no others and stays as it is.
Target NominalTarget(const Target& target);

/// The refined target (FORMATS.md): all keys of the nominal one, then `markers` and `sigma` of each
/// marker in `positions`. Markers of the target that are not in `positions` keep their place (and
/// get no sigma): they are written only where that is not the nominal one. Numbers that the target
/// does not have are left out. REQUIRES: finite positions and sigmas.
std::string RefinedTargetYaml(const Target& target,
                              const std::map<int, Eigen::Vector3d>& positions,
                              const std::map<int, Eigen::Vector3d>& sigmas);

}  // namespace plenocal
