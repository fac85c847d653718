// SPDX-License-Identifier: Apache-2.0
//
// The files and the summary that a calibration leaves behind (FORMATS.md, "calibration.yaml").
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "calib/calibrate.h"
#include "calib/calibration_file.h"

namespace plenocal {

/// calibration.yaml. `provenance`: lines "key: value" that say how to run it again.
std::string CalibrationYaml(const Calibration& calibration,
                            const std::vector<std::pair<std::string, std::string>>& provenance);
/// One camera as `ReadCalibration` reads it from that file.
CalibratedCamera CameraOf(const Calibration& calibration, size_t camera);
/// poses.csv: T_target_rig of every frame.
std::string PosesCsv(const Calibration& calibration);
/// view_poses.csv: T_target_rig as each camera saw it in each frame, to which the residuals belong.
/// In a rigid, synchronous rig that is the frame's own.
std::string ViewPosesCsv(const Calibration& calibration);
/// residuals.csv: every observation, measured minus predicted; those outside the model's domain
/// have no prediction and leave dx, dy empty. The column sigma is that of each coordinate under the
/// camera's noise.
std::string ResidualsCsv(const Calibration& calibration);
/// Of all free intrinsics and mounts. With the sigmas of calibration.yaml they give the covariance.
Correlations CorrelationsOf(const Calibration& calibration);
/// correlations.csv: these as a matrix, a row an unknown.
std::string CorrelationsCsv(const Calibration& calibration);
/// What a person wants to read after a calibration; ends in a newline.
std::string Summary(const Calibration& calibration);

}  // namespace plenocal
