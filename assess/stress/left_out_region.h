// SPDX-License-Identifier: Apache-2.0
//
// Predictions of points in a region of the image from which a calibration had none.
#pragma once

#include "assess/stress/part_calibration.h"
#include "assess/stress/stress.h"

namespace plenocal {

/// Sets the results or the failure of `test`: how well `trained`, with the points of `rest` alone,
/// predicts the other points of a camera, poses from those of `rest`. Tested is their score by the
/// camera's unknowns.
void TestLeftOutRegion(const Calibration& all,
                       const PartOfObservations& rest,
                       const PartCalibration& trained,
                       size_t camera,
                       StressTest* test);

}  // namespace plenocal
