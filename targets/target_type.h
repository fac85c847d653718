// SPDX-License-Identifier: Apache-2.0
//
// What a target type consists of. A type is a header in targets/types/ (with a source beside it)
// whose struct is named like the file in CamelCase + "Layout": chessboard.h has ChessboardLayout.
// CMake lists the folder; `TargetLayout` is the variant of all of them, and a struct that lacks a
// part of `IsTargetLayout` does not compile. Detection of the type is one file pair in detectors/
// (see detectors/types/marker_detectors.cc.in).
#pragma once

#include <Eigen/Core>
#include <array>
#include <concepts>
#include <map>
#include <span>
#include <string_view>
#include <vector>

#include "calib/camera/target_hypothesis.h"
#include "calib/io/yaml.h"
#include "targets/target_drawing.h"

namespace plenocal {

struct Target;

/// Marker number -> position in the target's frame, m.
using MarkerPositions = std::map<int, Eigen::Vector3d>;

/// Four markers at the corners of a rigid flat piece: lower left, lower right, upper right, upper
/// left as seen from the printed side.
using MarkerQuad = std::array<int, 4>;

/// A key of a target file. The readers accept the keys listed and no others.
struct TargetKey {
  std::string_view name;  ///< "tags.id": key `id` of each element of the list `tags`
  std::string_view unit;  ///< "m"; empty: none
  std::string_view meaning;
  std::string_view otherwise;  ///< what holds without the key; empty: the key must be there
};

/// A value of the key `type` (of Kalibr's files: `target_type`) and how its file is read.
struct TargetType {
  std::string_view name;
  std::span<const TargetKey> keys;  ///< without those that all types share
  /// A small target: values of its keys as YAML lines. The tests of all types run on it.
  std::string_view example;
  /// Layout and nominal markers of a file's root node. Throws `Error` with file, line and key.
  Target (*read)(const YamlNode& node);
  /// Keys whose values follow columns and rows where the target is one word ("square" for
  /// chessboard:9x6:25mm), separated by ':', with "=value" for one that may be left out; empty: the
  /// type cannot be described in a word.
  std::string_view word = {};
};

/// The parts of a target type:
///
///   kHasNominalMarkers  positions follow from the keys; else they are the file's key `markers`
///   Part(marker)        number of the flat part of the target on which a marker lies
///   Normal(...)         unit vector from a marker to the viewer of the printed side; zero: the
///                       marker is visible from everywhere
///   Quads()             rigid flat pieces with a marker at each corner, none for boards
///   Doubts(nominal)     mistakes in the file's keys (its nominal ones) that images can show;
///                       without `quads`
///   Draw(...)           black shapes on white parts, with every marker where the map has it
template <typename Layout>
concept IsTargetLayout = requires(const Layout& layout,
                                  const MarkerPositions& markers,
                                  const YamlNode& nominal,
                                  int marker,
                                  Pieces pieces) {
  {std::span<const TargetType>(Layout::kTypes)};
  { Layout::kHasNominalMarkers } -> std::convertible_to<bool>;
  { layout.Part(marker) } -> std::same_as<int>;
  { layout.Normal(markers, marker) } -> std::same_as<Eigen::Vector3d>;
  { layout.Quads() } -> std::same_as<std::vector<MarkerQuad>>;
  { layout.Doubts(nominal) } -> std::same_as<TargetDoubts>;
  { layout.Draw(markers, pieces) } -> std::same_as<std::vector<TargetPart>>;
};

}  // namespace plenocal
