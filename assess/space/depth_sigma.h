// SPDX-License-Identifier: Apache-2.0
//
// Standard error of the depth that a rig measures, as what a next view is to lower.
#pragma once

#include "assess/views/projection_sigma.h"

namespace plenocal {

/// z, mm, of points at `distance`, m, that the rig's master sees together with another ordinary
/// camera, or that one plenoptic camera sees; mean over the images and the pairs. Part of the
/// calibration alone: no view changes the noise. Throws `Error` of kind kInput for a rig that
/// measures no depth there.
ProjectionSigma DepthSigma(const RigEstimate& rig, const RigUnknowns& unknowns, double distance);

}  // namespace plenocal
