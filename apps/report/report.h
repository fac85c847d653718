// SPDX-License-Identifier: Apache-2.0
//
// report.html: one page that shows a calibration and needs no network.
#pragma once

#include <string>

#include "engine/session/calibration_folder.h"

namespace plenocal {

/// The page of a calibration. Throws `Error` of kind kInput with file and place when one of `files`
/// is damaged.
std::string ReportHtml(const CalibrationRecord& calibration, const CameraFiles& files);

}  // namespace plenocal
