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

}  // namespace plenocal::internal
