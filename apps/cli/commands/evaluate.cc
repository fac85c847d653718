// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <limits>
#include <memory>
#include <optional>

#include "apps/charts/bar_chart.h"
#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "apps/evaluate/evaluate_runs.h"
#include "calib/base/json_text.h"
#include "calib/io/output_folder.h"

namespace plenocal {
namespace {

struct EvaluateArguments : EvaluateRequest {
  bool json = false;
  std::filesystem::path chart;  ///< SVG or PNG; empty: none
};

BarChart ChartOf(const Evaluation& evaluation) {
  const auto& runs = evaluation.runs;
  BarChart chart;
  for (const EvaluatedRun& run : runs) chart.runs.push_back(run.name);
  const auto panel = [&](const std::string& title, double base, bool needs_scale, auto&& value) {
    BarPanel& added = chart.panels.emplace_back(BarPanel{title, base, {}});
    for (const EvaluatedRun& run : runs) {
      if (needs_scale && run.monocular) {
        added.values.emplace_back();
      } else if (!run.failure.empty()) {
        added.values.emplace_back(std::numeric_limits<double>::infinity());
      } else {
        added.values.emplace_back(value(run));
      }
    }
  };
  if (evaluation.has_loop) {
    panel("absolute scale error d_s'", 1, true, [](const EvaluatedRun& run) {
      return Folded(run.loop->absolute_scale);
    });
    panel("scale drift e_s'", 1, false, [](const EvaluatedRun& run) {
      return Folded(run.loop->ScaleDrift());
    });
    panel("alignment error e_align, % of path", 0, false, [](const EvaluatedRun& run) {
      return 100 * run.loop->alignment_error / run.loop->path_length;
    });
  } else {
    panel("ATE, m", 0, true, [](const EvaluatedRun& run) { return run.errors->ate_se3.rmse; });
    panel("ATE with scale, m", 0, false, [](const EvaluatedRun& run) {
      return run.errors->ate_sim3.rmse;
    });
    panel("RPE with scale, m", 0, false, [](const EvaluatedRun& run) {
      return run.errors->rpe_sim3.rmse;
    });
  }
  return chart;
}

void RunEvaluate(const EvaluateArguments& arguments, const ConsoleOptions& shared) {
  Console console(shared);
  std::optional<PictureFormat> format;
  if (!arguments.chart.empty()) format = PictureFormatOf(arguments.chart);
  const Evaluation evaluation = EvaluateRuns(arguments, console.NewRun());
  if (format) WriteOutput(arguments.chart, DrawBarChart(ChartOf(evaluation), *format));
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

RunCommand DeclareEvaluate(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<EvaluateArguments>();
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
  const CLI::Option* const monocular =
      app->add_option("--monocular",
                      arguments->monocular,
                      "runs that have no scale (without names: all of them)")
          ->expected(0, -1);
  app->add_flag("--json", arguments->json, "JSON on standard output");
  app->add_option("--chart", arguments->chart, "bar chart: FILE.svg or FILE.png");
  AddQuiet(app, shared);
  return [arguments, shared, monocular] {
    if (monocular->count() > 0) {
      // CLI11 hands over "no names" as one empty name.
      std::erase(arguments->monocular, "");
      arguments->monocular_runs = arguments->monocular.empty()
                                      ? EvaluateRequest::MonocularRuns::kAll
                                      : EvaluateRequest::MonocularRuns::kListed;
    }
    RunEvaluate(*arguments, *shared);
  };
}

}  // namespace

Command EvaluateCommand() { return {"evaluate", kEvaluateHelp, DeclareEvaluate}; }

}  // namespace plenocal
