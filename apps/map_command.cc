// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <array>

#include "apps/commands.h"
#include "apps/image_module.h"
#include "apps/resample.h"
#include "models/registry.h"

namespace plenocal {

void RunMap(const MapCommand& command, const ConsoleOptions& options) {
  const CalibrationFile calibration = ReadCalibration(command.calibration, CameraModels());
  const CalibratedCamera& camera = FindCamera(calibration, command.camera);
  const std::array seen{ImageOf(camera, Eigen::Matrix3d::Identity())};
  CalibratedCamera view = ChoosePinhole(seen, ToViewOptions(command.view));
  view.name = camera.name;
  view.T_camera_rig = camera.T_camera_rig;

  const std::string extension = command.out.extension().string();
  const bool storage = extension == ".yaml" || extension == ".yml" || extension == ".xml";
  const std::filesystem::path folder = storage ? command.out.parent_path() : command.out;
  OutputFolder out(folder.empty() ? "." : folder);
  const PixelMap map = MapPixels(view, camera, Eigen::Matrix3d::Identity(), options.threads);
  const std::string format = extension == ".xml" ? "xml" : storage ? "yml" : "";
  for (const auto& [name, content] : MapFilesByModule(map, view.params, format)) {
    out.Write(storage ? command.out.filename().string() : name, content);
  }
  if (!storage) {
    out.Write("calibration.yaml",
              CalibrationText(std::array{view},
                              {{"plenocal_version", PLENOCAL_VERSION},
                               {"undistorted_from", command.calibration.string()}}));
  }
  out.Commit();
  fmt::print("{}: {}\nwritten to {}\n", camera.name, ViewText(view), command.out.string());
}

}  // namespace plenocal
