// SPDX-License-Identifier: Apache-2.0
//
// Files of a vignetting from a wall.
#pragma once

#include <string>
#include <vector>

#include "apps/photometry/attenuation_compare.h"
#include "apps/photometry/vignette_fit.h"

namespace plenocal {

/// Conditions that the user should know, in words. `frames`: names of the views.
std::vector<std::string> FindingsOf(const VignetteEstimate& estimate,
                                    const std::vector<std::string>& frames);
/// exposures.csv: frame, camera, exposure_ms (recorded times gain), relative (gain - 1), sigma.
std::string ExposuresCsv(const VignetteEstimate& estimate,
                         const std::string& camera,
                         const std::vector<std::string>& frames,
                         const std::vector<double>& exposures);
/// A summary for the terminal.
std::string VignetteSummary(const VignetteEstimate& estimate,
                            const std::string& camera,
                            std::size_t views);
/// report.html. `comparison`: with white images; null: none.
std::string VignettePage(const VignetteEstimate& estimate,
                         const std::string& camera,
                         const std::vector<std::string>& frames,
                         const std::vector<std::string>& findings,
                         const AttenuationComparison* comparison);
/// wall.png: the wall's brightness, black where it was not seen.
std::string WallPng(const VignetteEstimate& estimate);

}  // namespace plenocal
