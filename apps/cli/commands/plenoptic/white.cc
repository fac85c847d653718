// SPDX-License-Identifier: Apache-2.0

#include "apps/cli/options.h"
#include "detectors/plenoptic/white/white_text.h"
#include "engine/plenoptic/white_files.h"

namespace plenocal {
namespace {

void RunWhite(const WhiteRequest& arguments, Console* console) {
  for (const auto& [camera, images, white] : MeasureWhiteImages(arguments, console->NewRun())) {
    console->Print(WhiteText(camera, images, white));
  }
}

constexpr const char* kWhiteHelp =
    "From white images to micro-image centres and attenuation.\n"
    "\n"
    "  plenocal white session.yaml -o OUT\n"
    "  plenocal white FOLDER --model focused-plenoptic -o OUT\n"
    "\n"
    "writes OUT/vignetting_<camera>.tiff, noise_<camera>.yaml and, for a plenoptic camera, micro_lenses_<camera>.csv, lattice_<camera>.yaml and grid_<camera>.png.";

void DeclareWhite(CLI::App* app, WhiteRequest* arguments, ConsoleOptions* shared) {
  app->add_option("input", arguments->inputs, "session.yaml; with --model a folder, glob or files")
      ->required();
  AddOut(app, &arguments->out);
  app->add_option("--model", arguments->model, "camera model of the images")->expected(1);
  app->add_option("--camera", arguments->camera, "name for the results (default: the folder's)");
  AddBayer(app, &arguments->bayer, "colours of the top-left 2 x 2 pixels of raw mosaics");
  app->add_option("--grid", arguments->grid, "RayCalibData XML with the micro-lens grid");
  app->add_flag("--xml", arguments->xml, "also write micro_lenses_<camera>.xml (RayCalibData)");
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command WhiteCommand() { return MakeCommand("white", kWhiteHelp, DeclareWhite, RunWhite); }

}  // namespace plenocal
