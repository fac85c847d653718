// SPDX-License-Identifier: Apache-2.0
//
// The folder that `plenocal calibrate` wrote, read back.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "calib/files/calibration_record.h"
#include "targets/target.h"

namespace plenocal {

/// The `Open` functions complete the folder's results first where a killed run left them half moved
/// (calib/io/output_folder.h), and throw `Error` of kind kInput with file, line and key or column.

/// calibration.yaml alone.
CalibrationRecord OpenCalibration(const std::filesystem::path& path);

/// calibration.yaml and, of cameras without a single centre, poses.csv and target.yaml if they are
/// beside it: what `CentralView` needs.
CalibrationRecord OpenForViews(const std::filesystem::path& path);

/// calibration.yaml with the correlations.csv beside it, if there is one.
CalibrationRecord OpenWithCorrelations(const std::filesystem::path& path);

/// calibration.yaml, target.yaml, poses.csv, residuals.csv and, if they exist, view_poses.csv and
/// correlations.csv.
CalibrationRecord OpenCalibrationFolder(const std::filesystem::path& folder);

/// The calibration.yaml of a recording: `given`, else the one that it names. Throws `Error` of kind
/// kInput when there is neither.
std::filesystem::path CalibrationOf(const std::filesystem::path& recording,
                                    const std::filesystem::path& named,
                                    const std::filesystem::path& given);

/// Adds the nominal marker positions of a target to a record, and markers that the record does not
/// have.
void AddTarget(const Target& target, CalibrationRecord* calibration);

/// Files of the cameras that the report draws or embeds: micro lenses, attenuation, pictures.
struct CameraFiles {
  std::filesystem::path folder;                 ///< for messages
  std::map<std::string, std::string> contents;  ///< by file name

  /// Content of a file; null for an empty name or a file that is not there.
  [[nodiscard]] const std::string* Find(const std::string& name) const;
  /// Path of a file, for messages.
  [[nodiscard]] std::string Path(const std::string& name) const { return (folder / name).string(); }
};

/// Reads those files that the cameras name and that exist. Throws `Error` for one that cannot be
/// read.
CameraFiles ReadCameraFiles(const std::filesystem::path& folder,
                            const CalibrationRecord& calibration);

}  // namespace plenocal
