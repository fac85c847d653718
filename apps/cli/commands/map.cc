// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <array>

#include "apps/cli/options.h"
#include "apps/cli/view_options.h"
#include "assess/central_view.h"
#include "calib/files/calibration_file.h"
#include "calib/io/output_folder.h"
#include "engine/resample/map_files.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {
namespace {

/// A camera and the pinhole camera that its remap tables lead to.
struct MapArguments {
  std::filesystem::path calibration;
  std::string camera;  ///< empty: the only one
  ViewOptions view;
  std::filesystem::path out;  ///< a folder, or FILE.yaml or FILE.xml of OpenCV
};

void RunMap(const MapArguments& arguments, Console* console) {
  const CalibrationRecord calibration = OpenForViews(arguments.calibration);
  const CentralView central(
      calibration, FindCamera(calibration, arguments.camera), arguments.view.distance);
  const CalibratedCamera& camera = central.camera();
  const CalibratedCamera view = UndistortedView(camera, arguments.view);
  const std::string extension = arguments.out.extension().string();
  const bool storage = extension == ".yaml" || extension == ".yml" || extension == ".xml";
  const PixelMap map =
      MapPixels(view, camera, Eigen::Matrix3d::Identity(), console->Options().threads);
  const std::string format = extension == ".xml" ? "xml" : storage ? "yml" : "";
  auto files = MapFiles(map, view.params, format);
  if (storage) {
    WriteOutput(arguments.out, files.begin()->second);
  } else {
    files["calibration.yaml"] = GivenCamerasYaml(
        std::array{view},
        central.WithDistance({{"plenocal_version", PLENOCAL_VERSION},
                              {"undistorted_from", arguments.calibration.string()}}));
    WriteInto(arguments.out, {files.begin(), files.end()});
  }
  central.Report(console->NewRun());
  console->Print(
      fmt::format("{}: {}\nwritten to {}\n", camera.name, ViewText(view), arguments.out.string()));
}

constexpr const char* kMapHelp =
    "Remap tables that undistort a camera's images, for cv::remap.\n"
    "\n"
    "  plenocal map calibration.yaml --camera NAME -o DIR | FILE.yaml | FILE.xml\n"
    "\n"
    "writes DIR/map_x.tiff, map_y.tiff (32-bit floats, px, -1 both where the camera images nothing), mask.png and calibration.yaml, the new camera; or one cv::FileStorage.";

void DeclareMap(CLI::App* app, MapArguments* arguments, ConsoleOptions* shared) {
  AddCalibration(app, &arguments->calibration);
  app->add_option("--camera", arguments->camera, "its camera (default: the only one)");
  app->add_option("-o,--out", arguments->out, "folder, or file of OpenCV")->required();
  AddViewOptions(app, &arguments->view);
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command MapCommand() { return MakeCommand("map", kMapHelp, DeclareMap, RunMap); }

}  // namespace plenocal
