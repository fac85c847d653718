// SPDX-License-Identifier: Apache-2.0
//
// The writer and the reader of calibration.yaml (docs/formats.md), and the keys of a camera that
// other files of the project share with it.
#pragma once

#include <filesystem>
#include <span>
#include <string>

#include "calib/camera/camera_model.h"
#include "calib/files/calibration_record.h"
#include "calib/io/yaml.h"

namespace plenocal {

/// calibration.yaml. Parameters and poses have all digits, so that they come back exactly.
/// Uncertainties, residuals and what follows `frames` are written when `adjustment` is set.
std::string CalibrationYaml(const CalibrationRecord& calibration);

/// calibration.yaml of cameras whose parameters were not estimated here: models, parameters and
/// poses alone.
std::string GivenCamerasYaml(std::span<const CalibratedCamera> cameras,
                             const Provenance& provenance);

/// Key `undetermined` with these directions.
std::string UndeterminedYaml(const std::vector<OpenDirection>& directions);

/// Reads a calibration.yaml; frames, markers, residuals and the matrix of correlations are in other
/// files (calibration_tables.h). All but model, image size, parameters and T_camera_rig may be
/// absent, as in simulated truth. Throws `Error` with file, line and key.
CalibrationRecord ReadCalibration(const std::filesystem::path& path,
                                  std::span<const CameraModel> models);

/// Throws at the node of a camera or target whose name cannot be one (`CameraNameDefect`).
void CheckName(const std::string& name, const YamlNode& node);

/// The model in `models` whose name `node` holds. Throws `Error` with file, line and key.
const CameraModel* ReadModel(const YamlNode& node, std::span<const CameraModel> models);

/// `[width, height]`, positive numbers of pixels. Throws likewise.
ImageSize ReadImageSize(const YamlNode& node);

/// `[c_x, c_y, r_x, r_y]`, px. Throws likewise.
ImageCircle ReadImageCircle(const YamlNode& node);

/// A value of `param`, within its limits. Throws likewise.
double ReadWithin(const YamlNode& node, const Param& param);

}  // namespace plenocal
