// SPDX-License-Identifier: Apache-2.0

#include "apps/cli/options.h"
#include "engine/plenoptic/focus_files.h"

namespace plenocal {
namespace {

void RunFocus(const FocusFilesRequest& arguments, Console* console) {
  FocusImages(arguments, console->NewRun());
  console->PrintWritten(arguments.out);
}

constexpr const char* kFocusHelp =
    "From raw images of a plenoptic camera to totally focused images and virtual depth.\n"
    "\n"
    "  plenocal focus RAW --white WHITE... -o OUT\n"
    "\n"
    "writes OUT/focused.png, virtual_depth.tiff, virtual_depth_sigma.tiff, virtual_depth.png, virtual_depth_16bit.png (RxLive) and focused.yaml; of several raw images OUT/<frame>/...";

void DeclareFocus(CLI::App* app, FocusFilesRequest* arguments, ConsoleOptions* shared) {
  app->add_option("raw", arguments->raw, "raw images: files, globs or folders")->required();
  AddOut(app, &arguments->out);
  AddPlenopticInputs(app, &arguments->camera);
  app->add_option("--markers",
                  arguments->markers,
                  "target.yaml: fit a plane to the depth of each marker found and focus again");
  app->add_option("--scale", arguments->scale, "raw pixels per pixel of the results")
      ->check(CLI::Range(0.5, 16.0))
      ->capture_default_str();
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command FocusCommand() { return MakeCommand("focus", kFocusHelp, DeclareFocus, RunFocus); }

}  // namespace plenocal
