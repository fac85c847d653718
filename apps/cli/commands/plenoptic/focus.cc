// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "engine/plenoptic/focus_images.h"

namespace plenocal {
namespace {

void RunFocus(const FocusFilesRequest& arguments, const ConsoleOptions& shared) {
  Console console(shared);
  FocusImages(arguments, console.NewRun());
  console.Print(fmt::format("written to {}\n", arguments.out.string()));
}

constexpr const char* kFocusHelp =
    "From raw images of a plenoptic camera to totally focused images and virtual depth.\n"
    "\n"
    "  plenocal focus RAW --white WHITE... -o OUT\n"
    "\n"
    "writes OUT/focused.png, virtual_depth.tiff, virtual_depth_sigma.tiff, virtual_depth.png, virtual_depth_16bit.png (RxLive) and focused.yaml; of several raw images OUT/<frame>/...";

RunCommand DeclareFocus(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<FocusFilesRequest>();
  app->add_option("raw", arguments->raw, "raw images: files, globs or folders")->required();
  app->add_option("-o,--out", arguments->out, "folder for the results")->required();
  AddPlenopticInputs(app, &arguments->camera);
  app->add_option("--markers",
                  arguments->markers,
                  "target.yaml: fit a plane to the depth of each marker found and focus again");
  app->add_option("--scale", arguments->scale, "raw pixels per pixel of the results")
      ->check(CLI::Range(0.5, 16.0))
      ->capture_default_str();
  AddThreadsAndQuiet(app, shared);
  return [arguments, shared] { RunFocus(*arguments, *shared); };
}

}  // namespace

Command FocusCommand() { return {"focus", kFocusHelp, DeclareFocus}; }

}  // namespace plenocal
