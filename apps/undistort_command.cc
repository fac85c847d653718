// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <array>

#include "apps/commands.h"
#include "apps/image_inputs.h"
#include "apps/image_module.h"
#include "apps/resample.h"
#include "models/registry.h"

namespace plenocal {

void RunUndistort(const UndistortCommand& command, const ConsoleOptions& options) {
  const CalibrationFile calibration = ReadCalibration(command.calibration, CameraModels());
  const CalibratedCamera& camera = FindCamera(calibration, command.camera);
  const std::array turned{TurnedCamera{&camera, Eigen::Matrix3d::Identity()}};
  CalibratedCamera view = ChoosePinhole(turned, ToViewOptions(command.view));
  view.name = camera.name;
  view.T_camera_rig = camera.T_camera_rig;

  const std::vector<FrameImage> images = FindImageInputs(command.images, "images");
  CheckImageNames(images, command.out);
  OutputFolder out(command.out);
  const PixelMap map = MapPixels(view, camera, Eigen::Matrix3d::Identity(), options.threads);
  const size_t count =
      ResampleInto(images, calibration, camera, map, command.resample, options, "", &out);
  if (command.resample.mask) out.Write("mask.png", MapFilesByModule(map, {}, "").at("mask.png"));
  out.Write("calibration.yaml",
            CalibrationText(std::array{view},
                            {{"plenocal_version", PLENOCAL_VERSION},
                             {"undistorted_from", command.calibration.string()}}));
  out.Commit();
  fmt::print("{}: {} images; {}\nwritten to {}\n",
             camera.name,
             count,
             ViewText(view),
             command.out.string());
}

}  // namespace plenocal
