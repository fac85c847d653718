// SPDX-License-Identifier: Apache-2.0
//
// A detected tag and the surroundings of its outline, of which its template is drawn.
#pragma once

#include <vector>

#include "targets/tags/quad.h"

namespace plenocal::internal {

/// A tag as detected and decoded.
struct SeenTag {
  Quad corners;  ///< px, good to a fraction of a bit
  /// Bits within the outline, row by row from the upright tag's upper left corner: true where the
  /// colour is not that of the ring just inside the outline.
  std::vector<bool> bits;
};

/// The surroundings of the outline, common to all tags of a target.
struct TagBorder {
  int width = 0;                ///< bits between the left and the right edge
  int ring = 1;                 ///< bits, width of the ring of one colour inside the outline
  double outside = 1;           ///< bits, width of the other colour's ring outside it
  int outside_sign = 1;         ///< 1 if that is white, -1 if black
  bool corner_squares = false;  ///< squares of the inner ring's colour touch the corners
};

}  // namespace plenocal::internal
