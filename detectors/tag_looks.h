// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <vector>

#include "detectors/tag_edges.h"
#include "targets/target.h"

namespace plenocal::internal {

/// How the tags of a target are drawn.
struct TagLooks {
  TagBorder border;
  std::map<int, std::vector<bool>> bits;  ///< by tag, as in `SeenTag`
};

/// REQUIRES: a target of tags. Throws `Error` for a family or tag that does not exist.
TagLooks FindTagLooks(const Target& target);

/// A whole tag as it is printed, row by row from the upright tag's upper left.
struct TagPicture {
  int width = 0;            ///< bits
  int margin = 0;           ///< bits between the picture's edge and the tag's outline
  std::vector<bool> white;  ///< width x width
};

/// The tags of a target, by id. Requires and throws as `FindTagLooks`.
std::map<int, TagPicture> DrawTags(const Target& target);

}  // namespace plenocal::internal
