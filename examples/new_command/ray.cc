// SPDX-License-Identifier: Apache-2.0
//
// A new command is one file in apps/cli/commands; this one is an example that scripts/add tries:
// the ray of a pixel.
#include <fmt/format.h>

#include <array>
#include <filesystem>

#include "apps/cli/options.h"
#include "calib/base/error.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {
namespace {

struct RayArguments {
  std::filesystem::path calibration;
  std::string camera;  ///< empty: the only one
  std::array<double, 2> pixel{};
};

void RunRay(const RayArguments& arguments, Console* /*console*/) {
  const CalibrationRecord calibration = OpenCalibration(arguments.calibration);
  const CalibratedCamera& camera = FindCamera(calibration, arguments.camera);
  if (!camera.model->IsCentral()) {
    throw Error(ErrorKind::kInput,
                fmt::format("camera '{}': {} is not central: a pixel alone has no ray",
                            camera.name,
                            camera.model->name));
  }
  const auto ray =
      camera.model->Unproject(camera.params.data(), camera.config.data(), arguments.pixel.data());
  if (!ray) throw Error(ErrorKind::kJob, "the camera images nothing at this pixel");
  const Eigen::Vector3d d = ray->direction.normalized();
  fmt::print("{:.9g} {:.9g} {:.9g}\n", d.x(), d.y(), d.z());
}

void Declare(CLI::App* app, RayArguments* arguments, ConsoleOptions* shared) {
  AddCalibration(app, &arguments->calibration);
  app->add_option("--camera", arguments->camera, "its camera (default: the only one)");
  app->add_option("--pixel", arguments->pixel, "x y, px")->required();
  AddQuiet(app, shared);
}

}  // namespace

Command RayCommand() {
  return MakeCommand("ray",
                     "Direction of the ray of a pixel, in the camera's frame.\n\n"
                     "  plenocal ray calibration.yaml --pixel 320 240",
                     Declare,
                     RunRay);
}

}  // namespace plenocal
