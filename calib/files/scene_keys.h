// SPDX-License-Identifier: Apache-2.0
//
// The keys of a session without a target: the scene, and the use of an earlier calibration; and
// measured distances of any session.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/io/yaml.h"

namespace plenocal {

/// A scene point, a marker, or the centre of a tag.
struct ScenePosition {
  std::string name;         ///< "point 12", "tag 3", "tag 3 corner 0"
  std::vector<int> points;  ///< numbers, as in the tracks; the position is that of their mean
};

/// "tag 3" or "tag 3 corner 0", whose corners have the numbers `point(id, corner)`; nothing for
/// another text.
std::optional<ScenePosition> TagPosition(const std::string& text, int (*point)(int id, int corner));

/// A measured distance between two positions in the scene.
struct SceneDistance {
  ScenePosition a, b;
  double length = 0, sigma = 0;  ///< m
  double common_sigma = 0;       ///< as `MarkerDistance::common_sigma`
  YamlNode place;                ///< of `a`, for messages
};

/// Tags that lie in the scene, where nobody has measured.
struct SceneTags {
  std::vector<int> ids;
  double size = 0, size_sigma = 0;  ///< m, side of a tag and its standard deviation; 0: not known
  YamlNode node;                    ///< the whole map, with the keys of the tags' family
};

/// Number of a tag's corner among the scene's points: above those of all tracks.
int TagPoint(int id, int corner);

/// `point` of a tag's four corners.
std::vector<int> CornersOfTag(int id, int (*point)(int id, int corner) = TagPoint);

/// `scene` of session.yaml.
struct SceneKeys {
  int points = 1000;  ///< wanted where points are looked for in images
  std::vector<SceneDistance> distances = {};
  std::optional<SceneTags> tags = {};
};

/// Sides and diagonals of a tag: each may deviate by `size_sigma`, and all of them
/// together by as much, since tags are printed at one scale. Empty where the size is not known.
std::vector<SceneDistance> SizesOfTag(const SceneTags& tags, int id);

/// A camera's keys about the session's earlier calibration; indices of parameters.
struct EarlierParams {
  std::optional<std::vector<size_t>> prior = {};  ///< these have a prior; not set: all
  std::vector<size_t> free = {};                  ///< these have a start value alone
  bool free_extrinsics = false;                   ///< so has T_camera_rig
};

/// Reads `distances` between markers: "marker 12", "tag 3", "tag 3 corner 0"; with several
/// `targets` after the name of one, "wall: tag 3", and numbered by `MarkerId`. Throws likewise.
std::vector<SceneDistance> ReadTargetDistances(const YamlNode& node,
                                               const std::vector<std::string_view>& targets);

/// Reads the map `scene`. Throws `Error` with file, line and key.
SceneKeys ReadSceneKeys(const YamlNode& node);

}  // namespace plenocal
