// SPDX-License-Identifier: Apache-2.0
//
// Target type of points without a pattern.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "targets/target_type.h"

namespace plenocal {

/// Points without a detector: their observations come from files, their positions are the file's
/// key `markers`, which all types share.
struct MarkersLayout {
  static Target Read(const YamlNode& node);
  static constexpr std::array kTypes{
      TargetType{"markers", {}, "markers: {0: [0, 0, 0], 12: [0.1, 0.2, 0.3]}\n", Read}};

  static constexpr bool kHasNominalMarkers = false;
  [[nodiscard]] static int Part(int /*marker*/) { return 0; }
  [[nodiscard]] static Eigen::Vector3d Normal(const MarkerPositions& /*markers*/, int /*marker*/) {
    return Eigen::Vector3d::Zero();
  }
  [[nodiscard]] static std::vector<MarkerQuad> Quads() { return {}; }
  [[nodiscard]] static TargetDoubts Doubts(const YamlNode& /*nominal*/) { return {}; }
  /// Throws `Error` of kind kInput: nothing is known about the points' appearance.
  [[nodiscard]] static std::vector<TargetPart> Draw(const MarkerPositions& markers, Pieces pieces);
};

}  // namespace plenocal
