// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "calib/camera_model.h"
#include "calib/rigid_transform.h"
#include "calib/yaml.h"

namespace plenocal {

/// One camera of a calibration.yaml.
struct CalibratedCamera {
  std::string name;
  const CameraModel* model = nullptr;
  ImageSize image_size{};
  std::vector<double> config;
  std::vector<double> params;
  /// Covariance of `params`; zero for held ones, and a variance is infinite (with zero
  /// covariances) for one that was not determined. Files without `correlation` give a diagonal.
  Eigen::MatrixXd covariance;
  RigidTransform T_camera_rig;
  Vector6d sigma_xi = Vector6d::Zero();  ///< of T_camera_rig's se(3) vector
  /// Names of files beside calibration.yaml: a plenoptic camera's micro lenses, the attenuation;
  /// empty: there is none.
  std::string micro_lenses = {}, vignetting = {};
};

/// calibration.yaml: the result of a calibration (FORMATS.md).
struct CalibrationFile {
  std::filesystem::path path;
  std::vector<CalibratedCamera> cameras;  ///< the first is the rig's master
};

/// Reads a calibration.yaml. `sigma`, `correlation`, `xi_camera_rig` and `sigma_xi` may be absent
/// (then zero), as in simulated truth. Throws `Error` with file, line and key.
CalibrationFile ReadCalibration(const std::filesystem::path& path,
                                std::span<const CameraModel> models);

/// Correlations of all unknowns of a calibration: parameters are called "camera.name", the
/// coordinates of a camera's se(3) vector "camera.T_camera_rig.x", y, z, w_x, w_y, w_z.
struct Correlations {
  std::vector<std::string> names;
  Eigen::MatrixXd matrix;
};

/// Covariance of the parameters and the se(3) vectors of some cameras of one file, camera by
/// camera. What `correlations` does not name has those of `CalibratedCamera::covariance` alone.
/// Infinite as there.
Eigen::MatrixXd JointCovariance(const std::vector<const CalibratedCamera*>& cameras,
                                const Correlations& correlations);

/// One camera of it: the value of key `name` under `cameras`.
CalibratedCamera ReadCalibratedCamera(const std::string& name,
                                      const YamlNode& node,
                                      std::span<const CameraModel> models);

/// Covariance as `CalibratedCamera` holds it.
Eigen::MatrixXd CovarianceOf(std::span<const double> sigma, const Eigen::MatrixXd& correlation);

/// The camera of that name; throws `Error` that names the known ones. An empty name stands for the
/// only camera.
const CalibratedCamera& FindCamera(const CalibrationFile& calibration, const std::string& name);

/// calibration.yaml of cameras whose parameters are given, without sigmas, with all digits that
/// they have. `provenance`: lines "key: value" that say where they come from.
std::string CalibrationText(std::span<const CalibratedCamera> cameras,
                            const std::vector<std::pair<std::string, std::string>>& provenance);

}  // namespace plenocal
