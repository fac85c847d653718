// SPDX-License-Identifier: Apache-2.0

#include "apps/cli/options.h"
#include "apps/photometry/recorded_vignette.h"
#include "apps/photometry/vignette_files.h"

namespace plenocal {
namespace {

void RunVignette(const VignetteRequest& arguments, Console* console) {
  const RecordedVignette result = MeasureVignette(arguments, console->NewRun());
  console->Print(VignetteSummary(result.estimate, result.camera, result.frames.size()));
  if (result.with_white) {
    console->Print("  " + ComparisonText(*result.with_white, "wall", "white images"));
  }
  console->PrintWritten(arguments.out);
}

constexpr const char* kVignetteHelp =
    "Vignetting of an ordinary camera from images of a flat wall with a marker.\n"
    "\n"
    "  plenocal vignette RECORDING --camera left --calibration calibration.yaml --target tag.yaml "
    "--response pcalib.txt -o OUT\n"
    "\n"
    "Writes vignetting_<camera>.tiff, its standard deviations, vignette.png, as DSO reads it, the "
    "wall, and a report; docs/photometry.md.";

void DeclareVignette(CLI::App* app, VignetteRequest* arguments, ConsoleOptions* shared) {
  AddRecording(app, &arguments->recording);
  app->add_option("--camera", arguments->camera, "camera of the recording (default: the only)")
      ->expected(1);
  app->add_option("--calibration",
                  arguments->calibration,
                  "calibration.yaml of the camera; else the one that the recording names");
  app->add_option("--target", arguments->target, "target.yaml of the marker on the wall")
      ->required();
  app->add_option("--response",
                  arguments->response,
                  "pcalib.txt; else the one that the recording names, or a linear response");
  app->add_option(
      "--white", arguments->white, "white images to compare with; else those of the recording");
  AddOut(app, &arguments->out);
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command VignetteCommand() {
  return MakeCommand("vignette", kVignetteHelp, DeclareVignette, RunVignette);
}

}  // namespace plenocal
