// SPDX-License-Identifier: Apache-2.0
//
// Makes report.html, one page that shows a calibration and needs no network.
#pragma once

#include <filesystem>
#include <string>

#include "calib/base/run.h"
#include "engine/calibrate_session.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {

/// The page of a calibration. Throws `Error` of kind kInput with file and place when one of `files`
/// is damaged.
std::string ReportHtml(const CalibrationRecord& calibration, const CameraFiles& files);

/// Adds report.html to the files of a calibration in the folder `out`. Where the page cannot be
/// made, `run` gets a message.
void AddReport(const std::filesystem::path& out, const Run& run, SessionCalibration* calibration);

/// What a rig or a plenoptic camera is worth at its farthest marker, a line for each set of
/// cameras, then an empty one; empty for one ordinary camera. `out` as in `AddReport`, for
/// messages.
std::string AccuracyLines(const std::filesystem::path& out, const SessionCalibration& calibration);

}  // namespace plenocal
