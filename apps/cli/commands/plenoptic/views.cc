// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "apps/cli/options.h"
#include "engine/plenoptic/view_files.h"

namespace plenocal {
namespace {

void RunViews(const ViewFilesRequest& arguments, Console* console) {
  const ViewsResult result = MakeViews(arguments, console->NewRun());
  console->Print(fmt::format("{}\nwritten to {}\n", result.summary, arguments.out.string()));
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

void DeclareViews(CLI::App* app, ViewFilesRequest* arguments, ConsoleOptions* shared) {
  app->add_option("raw", arguments->raw_image, "raw image")->required();
  AddOut(app, &arguments->out);
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
}

}  // namespace

Command ViewsCommand() { return MakeCommand("views", kViewsHelp, DeclareViews, RunViews); }

}  // namespace plenocal
