// SPDX-License-Identifier: Apache-2.0
//
// Unknowns that the data determine badly or not at all, in words, with the remedy.
#pragma once

#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/files/calibration_record.h"
#include "calib/noise/uncertainty.h"

namespace plenocal {

/// First the directions that are not determined, then weak unknowns: parameters of one camera that
/// correlate by more than 0.99 with each other, and single ones whose standard error is more than a
/// tenth of their size (`Param::scale`). Of the coefficients of a field (`Param::prior_sigma`)
/// those which priors determine more than the images: their standard error is above 0.7 of that by
/// the priors and known neighbours. Remedies come from the camera models.
std::vector<WeakUnknowns> FindWeakUnknowns(const Bundle& bundle, const Uncertainty& uncertainty);

/// "a, b, c", of many the first few and how many more.
std::string Listed(const std::vector<std::string>& names);

}  // namespace plenocal
