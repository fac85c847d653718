// SPDX-License-Identifier: Apache-2.0
//
// Two calibrations of a camera from disjoint halves of its frames.
#pragma once

#include <array>

#include "assess/stress/part_calibration.h"
#include "assess/stress/stress.h"

namespace plenocal {

/// Sets the results of `test`. `first`: the points of the first half.
void CompareHalves(const Calibration& all,
                   const PartOfObservations& first,
                   const std::array<PartCalibration, 2>& halves,
                   size_t camera,
                   StressTest* test);

}  // namespace plenocal
