// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <cstdio>

#include "apps/cli/options.h"
#include "apps/report/report.h"
#include "assess/verdict.h"
#include "calib/base/format_error.h"
#include "calib/base/json_text.h"
#include "calib/estimate/summary.h"
#include "engine/calibrate_session.h"
#include "engine/json/calibration_json.h"
#include "engine/session/open_session.h"

namespace plenocal {
namespace {

struct CalibrateArguments : CalibrateRequest {
  bool report = true;   ///< write report.html
  bool json = false;    ///< the result on standard output as JSON
  std::string require;  ///< name of the lowest grade that is no failure; empty: any
};

void CheckRequirement(const CalibrateArguments& arguments, const Verdict& verdict) {
  if (arguments.require.empty() || verdict.grade <= *ParseGrade(arguments.require)) return;
  std::fflush(stdout);
  throw Error(
      ErrorKind::kGrade,
      fmt::format("the calibration is {}, but --require asks for {} (results are in {}): {}",
                  GradeName(verdict.grade),
                  arguments.require,
                  arguments.out.string(),
                  verdict.findings.front().what));
}

void RunCalibrate(CalibrateArguments arguments, Console* console) {
  const std::string session = SessionFileOf(arguments.images, "calibrate");
  if (!session.empty()) {
    if (arguments.model != kAuto) {
      throw InputError("{}: a session has its models itself; --model goes with images", session);
    }
    arguments.session = OpenSession(session);
  }
  arguments.command = console->Options().program + " calibrate";
  const Run run = console->NewRun();
  SessionCalibration result = CalibrateSession(arguments, run);
  if (arguments.report) AddReport(arguments.out, run, &result);
  result.folders->Commit();
  if (arguments.json) {
    nlohmann::json json = CalibrationJson(result.record);
    json["output"] = arguments.out.string();
    fmt::print("{}\n", JsonText(json));
  } else {
    const std::string out = arguments.out.string();
    const bool wants_more =
        result.record.verdict->grade != Grade::kGood && !result.record.HasScene();
    console->Print(fmt::format(
        "{}\n{}written to {}{}\n\n{}",
        Summary(result.calibration),
        AccuracyLines(arguments.out, result),
        out,
        wants_more ? fmt::format("; what to record next: plenocal suggest {}", out) : "",
        VerdictText(*result.record.verdict)));
  }
  CheckRequirement(arguments, *result.record.verdict);
}

constexpr const char* kCalibrateHelp =
    "From images (or detections) to camera parameters, poses and target.\n\n"
    "  plenocal calibrate session.yaml -o OUT\n"
    "  plenocal calibrate 'images/*.jpg' --target chessboard:9x6:25mm -o OUT\n\n"
    "writes OUT/calibration.yaml, target.yaml (points.csv and points.ply of a session with a scene in place of a target), poses.csv, view_poses.csv (of a rig), residuals.csv, correlations.csv, detections_<camera>.csv, left_out.csv and report.html, and prints a summary. From images it writes OUT/session.yaml and nominal_target.yaml as well, from which the next step can start.";

void DeclareCalibrate(CLI::App* app, CalibrateArguments* arguments, ConsoleOptions* shared) {
  AddInputs(app, &arguments->images);
  app->add_option("--model",
                  arguments->model,
                  "of images: camera model; auto: as 'plenocal try' recommends it")
      ->capture_default_str();
  AddResultOptions(app, arguments, shared);
  app->add_flag("--jackknife",
                arguments->jackknife,
                "print beside each sigma that of a jackknife over frames");
  app->add_flag("!--no-report", arguments->report, "do not write OUT/report.html");
  app->add_flag("--json", arguments->json, "verdict and parameters as JSON on standard output");
  app->add_option(
         "--require", arguments->require, "exit status 3 when the verdict is worse: good or usable")
      ->check(CLI::IsMember({"good", "usable"}));
}

}  // namespace

Command CalibrateCommand() {
  return MakeCommand("calibrate", kCalibrateHelp, DeclareCalibrate, RunCalibrate);
}

}  // namespace plenocal
