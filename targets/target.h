// SPDX-License-Identifier: Apache-2.0
//
// Calibration targets: reading their files, their markers and what may be wrong in them.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/camera/marker_freedom.h"
#include "calib/files/session.h"
#include "calib/io/yaml.h"
#include "targets/target_layouts.h"
#include "targets/target_type.h"

namespace plenocal {

/// A calibration target: the pattern that a detector looks for and the position of each marker.
struct Target {
  TargetLayout layout;
  /// Refined positions where the file has them.
  MarkerPositions markers;
  /// Standard deviation of each nominal marker coordinate, m; empty when the file states none.
  std::optional<double> tolerance;
  /// Of the target's size, from `scale_sigma`: none, one, or one for each of the axes x and y; of
  /// several targets those of all.
  std::vector<TargetScale> scales;
  /// The file's own keys without `markers` and `sigma` of a refinement, as YAML lines, so that a
  /// refined target keeps them. For Kalibr's file: the equivalent keys of ours.
  std::string nominal_yaml;
  /// Nominal positions that these keys cannot state: of Kalibr's checkerboard of unequal spacings.
  MarkerPositions unequal = {};
};

/// All target types, in a fixed order.
std::vector<TargetType> TargetTypes();
/// The keys that all types have beside their own, in the order of a file.
std::span<const TargetKey> CommonTargetKeys();
/// The types of Kalibr's own target files (key `target_type`), which also take `tolerance`,
/// `scale_sigma`, `markers` and `sigma`.
std::span<const TargetType> KalibrTargetTypes();

/// Reads target.yaml of any type, or Kalibr's own target file (`target_type: aprilgrid`,
/// `checkerboard` or `circlegrid`). Throws `Error` with file, line and key.
Target ReadTarget(const std::filesystem::path& path);
/// The same of a file's root node.
Target ReadTarget(const YamlNode& node);
/// The target of a session: its file, or what the session itself has.
Target ReadTarget(const TargetSource& source);

/// A target in one word, as options and sessions have it: type, columns x rows, and the values of
/// `TargetType::word`, then any `key=value`.
///   chessboard:9x6:25mm                 inner corners, side of a square
///   aprilgrid:6x6:88mm:0.3[:tag36h11]   tags, side of a tag, gap / side, family
///   charuco:5x7:36mm:18mm:6X6_250       squares, side of a square and of a marker, dictionary
///   circles:10x7:25mm[:asymmetric]      circles, distance
/// Throws `Error` of kind kInput that begins with the word.
Target TargetOfWord(const std::string& word);

/// A target in one word, a file, or the text of one. Throws `Error` of kind kInput.
TargetSource TargetNamed(const std::string& target);

/// Number of the flat part of the target on which a marker lies: a tag's id; boards are one part.
int PartOf(const Target& target, int marker);

/// The target without its refinement: markers where the nominal keys put them. A target of type
/// `markers` has no others and stays as it is.
Target NominalTarget(const Target& target);

/// The parts of a target with every marker at its position in `target`. Throws `Error` of kind
/// kInput for type `markers` and unequal spacings, which cannot be drawn.
std::vector<TargetPart> DrawTarget(const Target& target, Pieces pieces = Pieces::kByPlane);

/// Mistakes in the target's file that images can show, for `FindTargetCauses`.
TargetDoubts DoubtsAbout(const Target& target);

/// The text of the refined target's file (docs/formats.md): all keys of the nominal one, then
/// `markers` and `sigma` of each marker in `positions`. Markers of the target that are not in
/// `positions` keep their position (and get no sigma): they are written only where it is not the
/// nominal one. Numbers that the target does not have are left out. REQUIRES: finite positions and
/// sigmas.
std::string RefinedTargetYaml(const Target& target,
                              const MarkerPositions& positions,
                              const MarkerPositions& sigmas);

}  // namespace plenocal
