// SPDX-License-Identifier: Apache-2.0
//
// Makes the answers about a run, as engine/json/calibration.schema.json has them.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "assess/compare_calibrations.h"
#include "calib/files/calibration_record.h"
#include "calib/files/frame_images.h"
#include "calib/files/session.h"

namespace plenocal::workbench {

/// Number, grade, RMS and number of frames of a run; only the number of one that cannot be read.
nlohmann::json RunBriefJson(const std::filesystem::path& folder, int number);

/// A run's result. Reading residuals of a large run takes a second: the last one is kept.
std::shared_ptr<const CalibrationRecord> RecordOf(const std::filesystem::path& folder);

/// `Run` of the schema (engine/json/calibration.schema.json).
nlohmann::json RunJson(const std::filesystem::path& folder, int number);

/// The points of one image: marker, x, y, dx, dy, used.
nlohmann::json PointsJson(const std::filesystem::path& folder,
                          const std::string& camera,
                          const std::string& frame);

/// `Residuals` of the schema.
nlohmann::json ResidualsJson(const std::filesystem::path& folder, const std::string& camera);

/// Micro-image centres of a plenoptic camera from its file: x, y, lens type; their pitch, raw px.
nlohmann::json LensesJson(const std::filesystem::path& folder,
                          const std::string& camera,
                          const std::filesystem::path& micro_lenses);

/// By how many standard errors the result changes without each frame, and what changes most; `why`
/// there is nothing for this calibration.
nlohmann::json InfluenceJson(const std::filesystem::path& folder);

/// Images of a camera of the session.
using ImagesOf = std::function<std::vector<FrameImage>(const std::string& camera)>;

/// What the run would be without the points that the session leaves out by now: `PreviewExclusion`;
/// null where it leaves out none of them, and for a calibration without a target.
nlohmann::json PreviewJson(const std::filesystem::path& folder,
                           const Session& session,
                           const ImagesOf& images_of);

/// `Space` of the schema.
nlohmann::json SpaceJson(const std::filesystem::path& folder);
/// `Accuracy`s of the schema, as the report has them.
nlohmann::json AccuracyJson(const std::filesystem::path& folder);

/// `Difference`s of the schema, by camera and distance.
nlohmann::json DifferenceJson(const CalibrationComparison& comparison);

/// `SigmaMap`s of the schema.
nlohmann::json MapsJson(const std::filesystem::path& folder, const std::string& camera);

}  // namespace plenocal::workbench
