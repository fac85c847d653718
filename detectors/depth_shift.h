// SPDX-License-Identifier: Apache-2.0
//
// What an error of the virtual depth does to markers in micro images. A marker is measured by a
// drawing of the target around it, whose size in the micro image goes with 1 / v. Where micro
// images blur, matching finds v too small by some thousandths. Then the drawing is too large, and
// since a micro image shows more of it on the side of its own centre, the marker is pushed outward.
// How far apart its micro images have a marker says what v is, some ten times as strongly as the
// drawing's size pulls at it. Of a single marker or part this says hardly more than matching did,
// and would carry its own noise into the measurements; of all images together it says what they
// have in common.
#pragma once

#include <vector>

#include "detectors/micro_observation.h"

namespace plenocal::internal {

/// Finds by how much the virtual depths of a camera's markers are wrong (relative, linear in 1 / v)
/// and makes the measurements what they would be without that.
void RemoveDepthShifts(std::vector<MicroView>* views);

}  // namespace plenocal::internal
