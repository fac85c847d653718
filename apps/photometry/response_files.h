// SPDX-License-Identifier: Apache-2.0
//
// A response from a recording, and its files.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "apps/photometry/response/response_fit.h"
#include "engine/recording/recording.h"

namespace plenocal {

/// Called with the images done; false stops (`Stopped` is thrown).
using ImageProgress = std::function<bool(std::size_t done, std::size_t total)>;

/// Reads some 100,000 pixels of all images, evenly spread. Images that cannot be read are left out
/// with their reason. Throws `Error`: of kind kInput without exposures or with 16 bits.
ExposureSweep ReadExposureSweep(const Recording& recording,
                                const RecordedCamera& camera,
                                int threads,
                                const ImageProgress& progress,
                                std::vector<LeftOut>* left_out);

/// Conditions that the user should know, in words.
std::vector<std::string> FindingsOf(const ResponseEstimate& estimate, const ExposureSweep& sweep);

/// response.csv: value, U, sigma (empty: not seen), count.
std::string ResponseCsv(const ResponseEstimate& estimate);
/// A summary for the terminal.
std::string ResponseSummary(const ResponseEstimate& estimate, const std::string& camera);
/// report.html.
std::string ResponsePage(const ResponseEstimate& estimate,
                         const ExposureSweep& sweep,
                         const std::string& camera,
                         const std::vector<std::string>& findings);

}  // namespace plenocal
