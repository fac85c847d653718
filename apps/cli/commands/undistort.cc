// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "apps/cli/options.h"
#include "apps/cli/view_options.h"
#include "calib/base/number_text.h"
#include "engine/images/undistort_images.h"

namespace plenocal {
namespace {

void RunUndistort(const UndistortRequest& arguments, Console* console) {
  const UndistortedImages made = UndistortImages(arguments, console->NewRun());
  console->Print(fmt::format("{}: {}; {}\nwritten to {}\n",
                             made.view.name,
                             Counted(made.count, "image"),
                             ViewText(made.view),
                             arguments.out.string()));
}

constexpr const char* kUndistortHelp =
    "Images without distortion, as a pinhole camera takes them.\n"
    "\n"
    "  plenocal undistort calibration.yaml --camera NAME IMAGES... -o DIR\n"
    "\n"
    "writes DIR/<image>.png (depth and colours of the image; black without source) and DIR/calibration.yaml, the new camera; of raw plenoptic images the totally focused image, DIR/<image>_depth.tiff and _depth_sigma.tiff (z and its sigma in metres, NaN unknown).";

void DeclareUndistort(CLI::App* app, UndistortRequest* arguments, ConsoleOptions* shared) {
  AddCalibration(app, &arguments->calibration);
  app->add_option("images", arguments->images, "images: files, globs or folders")->required();
  app->add_option("--camera", arguments->camera, "camera of the images (default: the only)")
      ->expected(1);
  app->add_option(
      "--cloud", arguments->cloud, "FILE.ply: point cloud of one raw plenoptic image, m");
  AddOut(app, &arguments->out);
  AddViewOptions(app, &arguments->view);
  AddResampleOptions(app, &arguments->settings);
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command UndistortCommand() {
  return MakeCommand("undistort", kUndistortHelp, DeclareUndistort, RunUndistort);
}

}  // namespace plenocal
