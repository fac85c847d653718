// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/base/yaml.h"
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
  /// The file's own keys without `markers` and `sigma` of a refinement, as YAML lines, so that a
  /// refined target keeps them. For Kalibr's file: the equivalent keys of ours.
  std::string nominal_yaml;
};

/// All target types, in a fixed order.
std::vector<TargetType> TargetTypes();
/// The keys that all types have beside their own, in the order of a file.
std::span<const TargetKey> CommonTargetKeys();
/// The types of Kalibr's own target files (key `target_type`), which also take `tolerance`,
/// `markers` and `sigma`.
std::span<const TargetType> KalibrTargetTypes();

/// Reads target.yaml of any type, or Kalibr's own target file (`target_type: aprilgrid`,
/// `checkerboard` or `circlegrid`). Throws `Error` with file, line and key.
Target ReadTarget(const std::filesystem::path& path);
/// The same of a file's root node.
Target ReadTarget(const YamlNode& node);

/// Number of the flat part of the target on which a marker lies: a tag's id; boards are one part.
int PartOf(const Target& target, int marker);

/// The target without its refinement: markers where the nominal keys put them. A target of type
/// `markers` has no others and stays as it is.
Target NominalTarget(const Target& target);

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
