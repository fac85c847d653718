// SPDX-License-Identifier: Apache-2.0
//
// The back end that gives Ceres all unknowns: for bundles with landmarks, or of models of which
// a point depends on few parameters, and for new unknowns until they are proven slow here.
#pragma once

#include "calib/adjust/bundle.h"
#include "calib/adjust/solution.h"

namespace plenocal::internal {

/// `Adjust` by this back end.
AdjustSummary MinimiseAllUnknowns(const AdjustOptions& options, Bundle* bundle);

}  // namespace plenocal::internal
