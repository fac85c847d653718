// SPDX-License-Identifier: Apache-2.0
//
// The reader and the writer of tables of detections.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "calib/camera/camera_model.h"
#include "calib/camera/observation.h"

namespace plenocal {

/// Reads a detections CSV (docs/formats.md) with the columns of `model`: frame, marker, the
/// measured coordinates, the context, and sigma (`Observation::detector_sigma`), which may be
/// absent or empty; x_shared_1, y_shared_1, x_shared_2, ..., which may be absent, are
/// `View::by_nuisance`, px. Columns are found by name, in any order; others are ignored. Views
/// are in the order in which their frames first appear. Throws `Error` with file, line and column
/// for a missing column, a value that is no finite number, a sigma that is not positive, or a row
/// that repeats frame, marker and context of another.
std::vector<View> ReadDetections(const std::filesystem::path& path, const CameraModel& model);

/// The table of detections as text.
std::string DetectionsCsv(std::span<const View> views, const CameraModel& model);

/// Name of a camera's file of detections.
std::string DetectionsName(const std::string& camera);

}  // namespace plenocal
