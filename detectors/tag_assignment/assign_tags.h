// SPDX-License-Identifier: Apache-2.0
//
// Square markers of several targets that share numbers: which square is of which target.
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "detectors/tag_assignment/tag_prediction.h"
#include "targets/target.h"

namespace plenocal::internal {

/// A square with a number, as read in one image; a number may occur more than once.
struct ReadTag {
  int id = 0;
  Quad corners;  ///< px
};

/// The squares of a target by their numbers.
using TagPositions = std::map<int, QuadPoints>;

/// Of a target with a `TagLayout`.
TagPositions TagsOf(const Target& target);

/// Whether both have the same numbers in the same arrangement, up to a change of scale.
bool IsSamePrint(const TagPositions& a, const TagPositions& b);

/// Where a square belongs.
struct TagOwner {
  std::optional<std::size_t> target;  ///< index of the target; nothing: undecided
  /// Of an undecided square: several targets fit, not none.
  bool fits_several = false;
};

/// Squares that follow one target from neighbour to neighbour are a group; the largest group comes
/// first. It belongs to the target that leaves significantly smaller residuals than every other
/// one. A target is in the image once, so that its squares are not looked for in a second group. Of
/// targets of the same print the first that is not in view yet has the group.
std::vector<TagOwner> AssignTags(const std::vector<ReadTag>& read,
                                 const std::vector<TagPositions>& targets);

/// For the user: why a `tag` or `marker` was left out.
std::string FitsSeveral(const char* what, int id);

}  // namespace plenocal::internal
