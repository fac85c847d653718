// SPDX-License-Identifier: Apache-2.0
//
// One archive of a result folder, for a report of a fault.
#pragma once

#include <filesystem>
#include <string>

namespace plenocal {

/// Zip archive of the documents and tables (.yaml, .csv) that `calibrate` or `detect` wrote into
/// `folder`, with the session and the target from `provenance` where the folder has no
/// session.yaml. `pictures`: of all files but the detection cache and earlier bundles. Equal files
/// give equal bytes. Completes the folder's results first, as `OpenCalibrationFolder`. Throws
/// `Error` of kind kInput for a folder without such files.
std::string ResultBundle(const std::filesystem::path& folder, bool pictures);

}  // namespace plenocal
