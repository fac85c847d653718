// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "apps/cli/options.h"
#include "apps/cli/view_options.h"
#include "calib/base/number_text.h"
#include "engine/images/rectify_images.h"

namespace plenocal {
namespace {

std::string SummaryText(const RectifiedPair& pair, const std::array<size_t, 2>& images) {
  return fmt::format(
      "{} and {}: {} and {} images; {}\nbaseline {:.6g} m{}\n",
      pair.views[0].name,
      pair.views[1].name,
      images[0],
      images[1],
      ViewText(pair.views[0]),
      pair.baseline,
      pair.turned         ? "; the cameras stand above each other: images turned by 90 degrees"
      : pair.baseline < 0 ? "; the second camera stands on the left: disparities are negative"
                          : "");
}

std::string EpipolarText(const EpipolarCheck& check) {
  if (!check.missing.empty()) {
    return fmt::format(
        "epipolar error: no {}; give the folder of the detections with --detections\n",
        check.missing.string());
  }
  const EpipolarErrors& errors = check.errors;
  if (errors.points == 0) {
    return "epipolar error: no marker was seen by both cameras in one frame\n";
  }
  return fmt::format(
      "epipolar error of the detected markers ({} and {}): vertical difference over {} in {}: RMS "
      "{:.4f} px, mean |dy| {:.4f} px, largest {:.3f} px\n",
      check.files[0].string(),
      check.files[1].string(),
      Counted(errors.points, "point"),
      Counted(errors.frames, "pair"),
      errors.rms,
      errors.mean_absolute,
      errors.largest);
}

void RunRectify(const RectifyRequest& arguments, Console* console) {
  const RectifiedImages made = RectifyImages(arguments, console->NewRun());
  console->Print(fmt::format("{}{}written to {}\n",
                             SummaryText(made.pair, made.images),
                             EpipolarText(made.epipolar),
                             arguments.out.string()));
}

constexpr const char* kRectifyHelp =
    "Stereo pairs whose points lie in equal rows.\n"
    "\n"
    "  plenocal rectify calibration.yaml 'left/*.png' 'right/*.png' -o DIR\n"
    "  plenocal rectify calibration.yaml LEFT_FOLDER RIGHT_FOLDER -o DIR --preview\n"
    "  plenocal rectify OUT/calibration.yaml --session session.yaml -o DIR\n"
    "\n"
    "writes DIR/<camera>/<frame>.png, DIR/calibration.yaml (two pinhole cameras of equal parameters, baseline along x) and rectification.yaml (R1 R2 P1 P2 Q of OpenCV); prints the epipolar error of the calibration's detections.";

void DeclareRectify(CLI::App* app, RectifyRequest* arguments, ConsoleOptions* shared) {
  AddCalibration(app, &arguments->calibration);
  app->add_option("left",
                  arguments->left,
                  "images of the first camera: glob, folder, file; or a folder of both");
  app->add_option("right", arguments->right, "images of the second camera, likewise");
  app->add_option("--session", arguments->session, "session.yaml that names the images")
      ->excludes("left");
  app->add_option("--cameras", arguments->cameras, "first and second camera (default: the two)")
      ->expected(2);
  app->add_option("--detections",
                  arguments->detections,
                  "folder of detections_<camera>.csv (default: that of the calibration)");
  AddOut(app, &arguments->out);
  app->add_flag("--maps", arguments->maps, "write <camera>/map_x.tiff and map_y.tiff");
  app->add_flag("--preview",
                arguments->preview,
                "write preview/<frame>.png: both images side by side with lines along rows");
  AddViewOptions(app, &arguments->view);
  AddResampleOptions(app, &arguments->settings);
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command RectifyCommand() {
  return MakeCommand("rectify", kRectifyHelp, DeclareRectify, RunRectify);
}

}  // namespace plenocal
