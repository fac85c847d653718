// SPDX-License-Identifier: Apache-2.0
//
// OUT/report.html: one page, without network, that shows a calibration.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "apps/report/attenuation_map.h"
#include "apps/report/results.h"

namespace plenocal {

/// `ReadAttenuationMap`, which needs OpenCV.
using AttenuationReader =
    std::function<AttenuationMap(const std::string& tiff, const std::string& name, int longer)>;

/// The page of a calibration's files. `folder` is for messages. Throws `Error` of kind kInput with
/// file and place when one is missing or damaged.
std::string ReportHtml(const ResultFiles& files,
                       const std::string& folder,
                       const AttenuationReader& read_attenuation);

/// Those files of a calibration's folder that `ReportHtml` reads.
ResultFiles ReadResultFiles(const std::filesystem::path& folder);

}  // namespace plenocal
