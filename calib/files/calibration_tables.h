// SPDX-License-Identifier: Apache-2.0
//
// Writers and readers of the tables beside calibration.yaml (docs/formats.md).
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// poses.csv: T_target_rig of every frame.
std::string PosesCsv(const CalibrationRecord& calibration);
/// Reads poses.csv. Throws `Error` with file, line and column, also for a frame that stands in it
/// twice and a quaternion that is not of length 1.
std::vector<FrameRecord> ReadPoses(const std::filesystem::path& path);

/// view_poses.csv: T_target_rig as each camera sees it in each frame; the residuals belong to these
/// poses. In a rigid, synchronous rig they are those of the frames.
std::string ViewPosesCsv(const CalibrationRecord& calibration);
/// Reads view_poses.csv into `CalibratedCamera::view_poses`. REQUIRES: `frames` are read.
void ReadViewPoses(const std::filesystem::path& path, CalibrationRecord* calibration);

/// points.csv: positions of the scene points of a calibration without a target, in the frame of the
/// first frame's rig.
std::string ScenePointsCsv(const CalibrationRecord& calibration);
/// Reads points.csv, of a calibration or a map, in the order of its rows: numbers and positions.
/// Throws `Error` with file, line and column, also for a point that stands in it twice.
std::vector<std::pair<int, Eigen::Vector3d>> ReadScenePoints(const std::filesystem::path& path);

/// Decimals of pixels in residuals.csv. `Describe` rounds residuals to them, so that results in
/// memory and those read from a file are the same numbers.
inline constexpr int kResidualDecimals = 5;
/// Decimals of noise_sigma: simulated observations may be all but exact.
inline constexpr int kNoiseSigmaDecimals = 9;

/// residuals.csv: every observation with its residual (measured minus predicted); observations
/// outside the model's domain have no prediction and leave the residual empty.
std::string ResidualsCsv(const CalibrationRecord& calibration);
/// Reads residuals.csv into `CalibratedCamera::residuals`. REQUIRES: `frames` and `markers` are
/// read. The column noise_sigma was called sigma before and may be absent.
void ReadResiduals(const std::filesystem::path& path, CalibrationRecord* calibration);

/// correlations.csv: the matrix, a row and a column per unknown.
std::string CorrelationsCsv(const Correlations& correlations);
Correlations ReadCorrelations(const std::filesystem::path& path);
/// correlations.csv beside the file of `calibration`; empty when there is none. Throws `Error` of
/// kind kInput when it is that of another calibration.
Correlations ReadCorrelationsBeside(const CalibrationRecord& calibration);

}  // namespace plenocal
