// SPDX-License-Identifier: Apache-2.0
//
// Two calibrations of a camera from disjoint halves of its points.
#pragma once

#include "assess/stress/part_calibration.h"
#include "assess/stress/stress.h"

namespace plenocal {

/// Fills in what the halves of a camera's points in `all` show; `test` has camera and split.
void CompareHalves(const Calibration& all,
                   const PartOfObservations& first,
                   const std::array<PartCalibration, 2>& halves,
                   size_t camera,
                   StressTest* test);

}  // namespace plenocal
