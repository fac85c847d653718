// SPDX-License-Identifier: Apache-2.0
//
// Displacement of markers by an error of the virtual depth (docs/plenoptic.md, "A wrong depth
// displaces"). A marker is measured by a template of the target around it, whose size in the micro
// image goes with 1 / v. Matching finds v too small by some thousandths where micro images are
// blurred. Then the template is too large, and since a micro image shows more of it on the side of
// its own centre, the marker is displaced outward.
//
// The distances between the positions of a marker in its micro images determine v some ten times as
// strongly as the template's size affects them. For a single marker or part that is hardly more
// precise than matching, and its noise would enter the measurements; so only the error that all
// markers share is corrected.
#pragma once

#include <vector>

#include "detectors/plenoptic/markers/marker_measurement.h"

namespace plenocal::internal {

/// Estimates the relative error of the virtual depths of a camera's markers, linear in 1 / v, and
/// corrects the measurements to those of templates without that error.
void CorrectDepthBias(std::vector<RawMeasurements>* images);

}  // namespace plenocal::internal
