// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <optional>
#include <utility>

#include "apps/cli/options.h"
#include "apps/cli/result_pictures.h"
#include "apps/evaluate/evaluate_runs.h"
#include "calib/base/json_text.h"
#include "calib/io/output_folder.h"

namespace plenocal {
namespace {

struct EvaluateArguments : EvaluateRequest {
  bool json = false;
  std::filesystem::path chart;  ///< SVG or PNG; empty: none
};

void RunEvaluate(const EvaluateArguments& arguments, Console* console) {
  std::optional<PictureFormat> format;
  if (!arguments.chart.empty()) format = PictureFormatOf(arguments.chart);
  const Evaluation evaluation = EvaluateRuns(arguments, console->NewRun());
  if (format) WriteOutput(arguments.chart, EvaluationPicture(evaluation, *format));
  fmt::print(
      "{}",
      arguments.json ? JsonText(EvaluationJson(evaluation)) + "\n" : EvaluationText(evaluation));
}

constexpr const char* kEvaluateHelp =
    "Drift of visual odometry over one large loop, ATE and RPE.\n"
    "\n"
    "  plenocal evaluate --estimate TRAJ --truth SEGMENTS --json\n"
    "  plenocal evaluate --estimate DSO=dso.txt ORB2=orb2.txt --monocular DSO --truth SEGMENTS --chart drift.svg\n"
    "\n"
    "Trajectories in the formats of TUM, ORB-SLAM, EuRoC and KITTI; docs/exchange.md.";

void DeclareEvaluate(CLI::App* app, EvaluateArguments* arguments, ConsoleOptions* shared) {
  app->add_option(
         "--estimate", arguments->estimates, "estimated trajectories, each FILE or NAME=FILE")
      ->required();
  app->add_option(
      "--truth",
      arguments->truth,
      "ground truth of start and end in one file, split at its largest gap; or of the whole path");
  app->add_option("--camera", arguments->camera, "camera of groundtruth.yaml; else its first");
  app->add_option("--start", arguments->start, "ground truth of the start segment");
  app->add_option("--end", arguments->end, "ground truth of the end segment");
  app->add_option("--times", arguments->times, "times of KITTI poses, s, one a line");
  app->add_option(
         "--tolerance", arguments->tolerance, "largest time between a pose and its ground truth, s")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  app->add_option(
         "--delta", arguments->delta, "poses between the two ends of a relative pose error")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  app->add_option_function<std::vector<std::string>>(
         "--monocular",
         [arguments](std::vector<std::string> runs) {
           std::erase(runs, "");  // CLI11 hands over "no names" as one empty name
           arguments->monocular_runs = runs.empty() ? EvaluateRequest::MonocularRuns::kAll
                                                    : EvaluateRequest::MonocularRuns::kListed;
           arguments->monocular = std::move(runs);
         },
         "runs that have no scale (without names: all of them)")
      ->expected(0, -1);
  AddJson(app, &arguments->json);
  app->add_option("--chart", arguments->chart, "bar chart: FILE.svg or FILE.png");
  AddQuiet(app, shared);
}

}  // namespace

Command EvaluateCommand() {
  return MakeCommand("evaluate", kEvaluateHelp, DeclareEvaluate, RunEvaluate);
}

}  // namespace plenocal
