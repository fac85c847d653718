// SPDX-License-Identifier: Apache-2.0
#include "engine/session/calibration_folder.h"

#include <algorithm>

#include "calib/base/format_error.h"
#include "calib/files/calibration_file.h"
#include "calib/files/calibration_tables.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "calib/io/yaml.h"
#include "models/formula/model.h"
#include "models/registry.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

// The path of a file that must be there.
fs::path Required(const fs::path& folder, const char* name) {
  std::error_code error;
  if (fs::exists(folder / name, error)) return folder / name;
  throw InputError("{}: no such file; is this the folder that 'plenocal calibrate' wrote?",
                   (folder / name).string());
}

void ReadRefinedTarget(const fs::path& path, CalibrationRecord* calibration) {
  const YamlNode node = YamlNode::ReadFile(path);
  AddTarget(ReadTarget(node), calibration);
  if (!node.Has("sigma")) return;
  for (const auto& [key, value] : node.At("sigma").Entries()) {
    const std::vector<double> sigma = value.AsNumbers(3);
    calibration->markers[std::stoi(key)].sigma = Eigen::Vector3d(sigma[0], sigma[1], sigma[2]);
  }
}

// After the formulas that the file carries.
CalibrationRecord ReadWithModels(const fs::path& path) {
  AddFormulaModels(path);
  return ReadCalibration(path, CameraModels());
}

}  // namespace

CalibrationRecord OpenCalibration(const fs::path& path) {
  CompleteResults(path);
  return ReadWithModels(path);
}

CalibrationRecord OpenForViews(const fs::path& path) {
  CalibrationRecord calibration = OpenCalibration(path);
  const bool is_axial = std::ranges::any_of(
      calibration.cameras,
      [](const CalibratedCamera& camera) { return camera.model->centre == Centre::kAxis; });
  const fs::path poses = path.parent_path() / "poses.csv",
                 target = path.parent_path() / "target.yaml";
  std::error_code error;
  if (!is_axial || !fs::exists(poses, error) || !fs::exists(target, error)) return calibration;
  ReadRefinedTarget(target, &calibration);
  calibration.frames = ReadPoses(poses);
  return calibration;
}

CalibrationRecord OpenWithCorrelations(const fs::path& path) {
  CalibrationRecord calibration = OpenCalibration(path);
  calibration.correlations = ReadCorrelationsBeside(calibration);
  return calibration;
}

fs::path CalibrationOf(const fs::path& recording, const fs::path& named, const fs::path& given) {
  if (!given.empty()) return given;
  if (!named.empty()) return named;
  throw InputError("{}: names no calibration; give --calibration calibration.yaml",
                   recording.string());
}

CalibrationRecord OpenCalibrationFolder(const fs::path& folder) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) {
    throw InputError("{}: no folder that can be read; give the one that 'plenocal calibrate' wrote",
                     folder.string());
  }
  CompleteResults(folder);
  CalibrationRecord calibration = ReadWithModels(Required(folder, "calibration.yaml"));
  if (calibration.HasScene()) {
    for (const auto& [number, position] : ReadScenePoints(Required(folder, "points.csv"))) {
      calibration.markers[number] = {.position = position};
    }
  } else {
    ReadRefinedTarget(Required(folder, "target.yaml"), &calibration);
  }
  calibration.frames = ReadPoses(Required(folder, "poses.csv"));
  if (fs::exists(folder / "view_poses.csv", error)) {
    ReadViewPoses(folder / "view_poses.csv", &calibration);
  }
  ReadResiduals(Required(folder, "residuals.csv"), &calibration);
  if (fs::exists(folder / "correlations.csv", error)) {
    calibration.correlations = ReadCorrelations(folder / "correlations.csv");
  }
  return calibration;
}

void AddTarget(const Target& target, CalibrationRecord* calibration) {
  const std::map<int, Eigen::Vector3d> nominal = NominalTarget(target).markers;
  for (const auto& [number, position] : target.markers) {
    const auto [place, is_new] = calibration->markers.try_emplace(number);
    MarkerRecord& marker = place->second;
    if (is_new) marker.position = position;
    const auto found = nominal.find(number);
    marker.nominal.reset();
    if (found != nominal.end()) marker.nominal = found->second;
  }
}

const std::string* CameraFiles::Find(const std::string& name) const {
  const auto found = contents.find(name);
  return name.empty() || found == contents.end() ? nullptr : &found->second;
}

CameraFiles ReadCameraFiles(const fs::path& folder, const CalibrationRecord& calibration) {
  CameraFiles files{folder, {}};
  for (const CalibratedCamera& camera : calibration.cameras) {
    for (const std::string& name :
         {camera.micro_lenses, camera.vignetting, camera.sample, camera.sample_depth}) {
      std::error_code error;
      if (name.empty() || !fs::is_regular_file(folder / name, error)) continue;
      files.contents[name] = ReadInput(folder / name, InputLimit::kTable);
    }
  }
  return files;
}

}  // namespace plenocal
