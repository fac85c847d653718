// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "engine/plenoptic/view_images.h"

namespace plenocal {
namespace {

void RunViews(const ViewFilesRequest& arguments, const ConsoleOptions& shared) {
  Console console(shared);
  const ViewsResult result = MakeViews(arguments, console.NewRun());
  console.Print(fmt::format("{}\nwritten to {}\n", result.summary, arguments.out.string()));
}

constexpr const char* kViewsHelp =
    "Sub-aperture images and refocused images of a raw plenoptic image, of focused and of\n"
    "unfocused cameras.\n"
    "\n"
    "  plenocal views RAW --white WHITE... -o OUT\n"
    "  plenocal views RAW --white WHITE... --calibration calibration.yaml --distance 0.5 0.8 -o "
    "OUT\n"
    "\n"
    "writes OUT/view_<row>_<column>.png, views.png (all of them), refocused_<k>.png and views.yaml.";

RunCommand DeclareViews(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<ViewFilesRequest>();
  app->add_option("raw", arguments->raw_image, "raw image")->required();
  app->add_option("-o,--out", arguments->out, "folder for the results")->required();
  AddPlenopticInputs(app, &arguments->lenses);
  app->add_option("--distance",
                  arguments->distances,
                  "distances at which refocused images are sharp, m; needs --calibration")
      ->check(CLI::PositiveNumber);
  app->add_option("--depth",
                  arguments->depths,
                  "virtual depths of refocused images (default: three of the image)")
      ->check(CLI::Range(-1000.0, 1000.0));
  app->add_option("--calibration", arguments->calibration, "calibration.yaml of the camera");
  app->add_option(
      "--camera", arguments->camera_name, "its name there, where several are plenoptic");
  app->add_option("--views", arguments->views, "sub-aperture images along either axis")
      ->check(CLI::Range(1, 31))
      ->capture_default_str();
  app->add_option("--radius",
                  arguments->radius,
                  "of the outermost sub-aperture images from the middle of the micro images, "
                  "pitches")
      ->check(CLI::Range(0.0, 0.5))
      ->capture_default_str();
  app->add_option("--scale", arguments->step, "raw pixels per pixel of the results")
      ->check(CLI::Range(0.5, 64.0))
      ->capture_default_str();
  AddThreadsAndQuiet(app, shared);
  return [arguments, shared] { RunViews(*arguments, *shared); };
}

}  // namespace

Command ViewsCommand() { return {"views", kViewsHelp, DeclareViews}; }

}  // namespace plenocal
