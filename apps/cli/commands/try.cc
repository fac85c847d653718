// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "apps/cli/options.h"
#include "apps/report/trial_page.h"
#include "engine/session/open_session.h"
#include "engine/try_session.h"

namespace plenocal {
namespace {

struct TryArguments : TryRequest {
  std::filesystem::path session;
};

void RunTry(TryArguments request, Console* console) {
  request.command = console->Options().program + " try";
  const SessionTrial trial = TrySession(OpenSession(request.session), request, console->NewRun());
  trial.folders->out()->Write("try.html", TrialPage(trial));
  trial.folders->Commit();
  console->Print(fmt::format("{}\nrecommended: {}\ntarget: {}\n\nwritten to {}\n",
                             TrialTable(trial.models, trial.rows),
                             ModelRecommendation(trial.models),
                             TargetRecommendation(trial.targets, trial.marker_freedom),
                             request.out.string()));
}

constexpr const char* kTryHelp =
    "Which camera model fits best: the cameras are calibrated with each model, which is judged by frames that were held out; the target likewise, held rigid and refined.\n"
    "\n"
    "  plenocal try session.yaml --models A,B,C -o OUT\n"
    "\n"
    "writes OUT/try.csv, try.yaml, try.html and models/<model>/calibration.yaml.";

void DeclareTry(CLI::App* app, TryArguments* arguments, ConsoleOptions* shared) {
  AddSession(app, &arguments->session);
  app->add_option("--models",
                  arguments->models,
                  "camera models, separated by commas (default: all of the cameras' kind)")
      ->delimiter(',');
  app->add_option("--camera",
                  arguments->camera,
                  "of a rig: whose model is varied (default: all ordinary cameras)");
  app->add_option("--folds", arguments->folds, "parts of the frames that are held out in turn")
      ->check(CLI::Range(2, 1000))
      ->capture_default_str();
  AddOut(app, &arguments->out);
  AddThreadsAndQuiet(app, shared);
  app->add_flag("--fresh", arguments->fresh, "detect again in all images");
}

}  // namespace

Command TryCommand() { return MakeCommand("try", kTryHelp, DeclareTry, RunTry); }

}  // namespace plenocal
