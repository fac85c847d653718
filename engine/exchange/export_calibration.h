// SPDX-License-Identifier: Apache-2.0
//
// A calibration as another tool's file.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "calib/base/run.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

struct ExportRequest {
  std::filesystem::path calibration;  ///< calibration.yaml, where none is given as a record
  std::string format;                 ///< name of a `CameraFormat`
  std::vector<std::string> cameras;   ///< in this order; empty: all
  std::filesystem::path response;     ///< pcalib.txt, for formats that hold a vignetting
  std::filesystem::path out;          ///< file, or folder of formats that hold poses and points
};

/// Returns the files written. Throws `Error`.
std::vector<std::filesystem::path> ExportCalibration(const ExportRequest& request, const Run& run);
std::vector<std::filesystem::path> ExportCalibration(const CalibrationRecord& calibration,
                                                     const ExportRequest& request,
                                                     const Run& run);

}  // namespace plenocal
