// SPDX-License-Identifier: Apache-2.0
//
// Mistakes that are made with a target, by the images that another target than that of its file
// would give.
#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <map>
#include <string>
#include <vector>

namespace plenocal {

/// Marker number -> positions that the point with this number may really have on the target, m.
/// Several places where the wrong file leads the detector now to this, now to that point.
using CandidatePlaces = std::map<int, std::vector<Eigen::Vector3d>>;

/// A target that may be in the images in place of the stated one.
struct TargetHypothesis {
  std::string code;    ///< of the finding (docs/diagnosis.md): "target_layout"
  std::string what;    ///< a clause about the images: "the tags run in 5 columns"
  std::string remedy;  ///< keys and values to set: "set columns: 5 and rows: 6"
  /// Made when they are asked for: those of all hypotheses about a target of a million points would
  /// take gigabytes.
  std::function<CandidatePlaces()> places;
};

/// A number in the target's file on which marker positions depend linearly and that can be wrong.
struct TargetNumber {
  std::string code;                          ///< of the finding
  std::string key;                           ///< "spacing"
  std::string meaning;                       ///< "gap between tags / size"
  double stated = 0;                         ///< the file's value
  double least = 0, most = 0;                ///< between which it is searched
  std::map<int, Eigen::Vector3d> by_number;  ///< derivatives of the marker positions
};

/// All that can be tested about the file of one target.
struct TargetDoubts {
  std::vector<TargetHypothesis> hypotheses;
  std::vector<TargetNumber> numbers;
  /// Markers at the corners of rigid flat pieces (tags): lower left, lower right, upper right,
  /// upper left.
  std::vector<std::array<int, 4>> quads;
  /// Unit vector from a marker to the viewer of the printed side; none for markers that are visible
  /// from everywhere.
  std::map<int, Eigen::Vector3d> normals = {};
  bool unit_is_stated = false;  ///< a length in the file has its unit, "25 mm"
  std::string unknown = {};     ///< key of the length that is unknown and counts as 1; or empty
};

}  // namespace plenocal
