// SPDX-License-Identifier: Apache-2.0
//
// Predictions of points in a part of the image from which a calibration had none.
#pragma once

#include "assess/stress/part_calibration.h"
#include "assess/stress/stress.h"

namespace plenocal {

/// Fills in what points that are not in `rest`, with the poses from those that are, show of a
/// camera's calibration without them.
void TestLeftOutRegion(const Calibration& all,
                       const PartOfObservations& rest,
                       const PartCalibration& trained,
                       size_t camera,
                       StressTest* test);

}  // namespace plenocal
