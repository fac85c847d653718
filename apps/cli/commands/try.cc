// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "apps/cli/options.h"
#include "apps/report/trial_page.h"
#include "engine/try_session.h"

namespace plenocal {
namespace {

struct TryArguments : TryRequest {
  ImageArguments inputs;
};

void RunTry(TryArguments request, Console* console) {
  request.command = console->Options().program + " try";
  // NAME alone.
  std::erase_if(request.inputs.cameras, [&](const std::string& camera) {
    const bool is_name = camera.find('=') == std::string::npos;
    if (is_name) request.camera = camera;
    return is_name;
  });
  const Run run = console->NewRun();
  const SessionTrial trial = TrySession(OpenInputs(request.inputs, "try", run), request, run);
  trial.folders->out()->Write("try.html", TrialPage(trial));
  trial.folders->Commit();
  console->Print(fmt::format(
      "{}\nrecommended: {}\ntarget: {}\n{}\nwritten to {}\n",
      TrialTable(trial.models, trial.rows),
      ModelRecommendation(trial.models),
      TargetRecommendation(trial.targets, trial.marker_freedom),
      ConfidenceText(trial.models) + MissingText(trial.missing) + StressText(trial.stress),
      request.out.string()));
}

constexpr const char* kTryHelp =
    "Which camera model fits best: the cameras are calibrated with each model, which is judged by frames that were held out; the target likewise, held rigid and refined.\n"
    "\n"
    "  plenocal try session.yaml --models A,B,C -o OUT\n"
    "  plenocal try 'images/*.jpg' --target chessboard:9x6:25mm -o OUT\n"
    "\n"
    "writes OUT/try.csv, try.yaml, try.html and models/<model>/calibration.yaml.";

void DeclareTry(CLI::App* app, TryArguments* arguments, ConsoleOptions* shared) {
  AddInputs(app, &arguments->inputs);
  app->add_option(
         "--models",
         arguments->models,
         "camera models, separated by commas; splined-all: splines of 7 to 30 knots along the image (default: all of the cameras' kind)")
      ->delimiter(',');
  app->get_option("--camera")
      ->description(
          "NAME=GLOB: images of a camera; NAME alone: of a rig, whose model is varied (default: all "
          "ordinary cameras)");
  app->add_option("--folds", arguments->folds, "parts of the frames that are held out in turn")
      ->check(CLI::Range(2, 1000))
      ->capture_default_str();
  app->add_flag(
      "--stress",
      arguments->stress,
      "calibrate the recommended model from halves of the frames and without regions of the "
      "image, and compare (the time of about two calibrations)");
  AddOut(app, &arguments->out);
  AddThreadsAndQuiet(app, shared);
  app->add_flag("--fresh", arguments->fresh, "detect again in all images");
}

}  // namespace

Command TryCommand() { return MakeCommand("try", kTryHelp, DeclareTry, RunTry); }

}  // namespace plenocal
