// SPDX-License-Identifier: Apache-2.0
//
// The test whether new images agree with the earlier calibration from which a calibration started.
#pragma once

#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/files/finding.h"
#include "calib/noise/uncertainty.h"

namespace plenocal {

/// Findings `prior_contradicted`, a parameter or component of the extrinsics each, largest effect
/// first, where the images contradict `Bundle::prior`: with a correct prior the deviation of the
/// estimate from it has the covariance C_prior - C, of which all is tested at once (chi-square).
/// Nothing without a prior. Of a calibration whose standard errors are those of the noise alone.
std::vector<Finding> FindingsOfPrior(const Bundle& bundle, const Uncertainty& uncertainty);

}  // namespace plenocal
