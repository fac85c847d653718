// SPDX-License-Identifier: Apache-2.0
//
// A target in the form that the choice of views needs.
#pragma once

#include "assess/views/rig_estimate.h"
#include "targets/target.h"

namespace plenocal {

/// A target as next views need it. Its finest detail is a bit of its tags, or a third of a square
/// or disc of boards without tags, whose detectors need that much more of an image.
ViewTarget MakeViewTarget(const Target& target);

}  // namespace plenocal
