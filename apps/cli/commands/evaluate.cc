// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <variant>

#include "apps/charts/bar_chart.h"
#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "apps/evaluate/trajectory_metrics.h"
#include "apps/evaluate/truth_uncertainty.h"
#include "calib/base/error.h"
#include "calib/base/names.h"
#include "calib/base/number_text.h"
#include "calib/io/output_folder.h"

namespace plenocal {
namespace {

/// Estimated trajectories and their ground truth.
struct EvaluateArguments {
  std::vector<std::string> estimates;  ///< files, or NAME=FILE
  std::filesystem::path truth;         ///< both segments, the whole path, or groundtruth.yaml
  std::string camera;                  ///< of groundtruth.yaml; empty: its first
  std::filesystem::path start, end;    ///< or one file per segment
  std::filesystem::path times;         ///< times of KITTI poses; empty: none
  double tolerance = 0.01;             ///< s between an estimated pose and its ground truth
  int delta = 1;                       ///< poses between the two ends of a relative error
  std::vector<std::string> monocular;  ///< runs without scale; see `monocular_runs`
  enum class MonocularRuns { kNone, kListed, kAll } monocular_runs = MonocularRuns::kNone;
  bool json = false;
  std::filesystem::path chart;  ///< SVG or PNG; empty: none
};

using Json = nlohmann::ordered_json;

/// The truth of all runs.
struct Truth {
  Trajectory whole;                                  ///< both segments, when there are two
  std::optional<LoopTruth> loop;                     ///< nothing: the truth covers the whole path
  std::optional<TruthUncertainty> uncertainty = {};  ///< of both segments
};

/// One run of an algorithm: what was measured, or why nothing could be.
struct Run {
  std::string name;
  std::filesystem::path path;
  bool monocular = false;
  std::optional<LoopMetrics> loop;
  std::optional<LoopMetricErrors> loop_errors;
  std::optional<PathErrors> errors;
  std::string failure;
};

Trajectory ReadAndReport(const std::filesystem::path& path,
                         const EvaluateArguments& arguments,
                         Console* console) {
  Trajectory trajectory = ReadTrajectory(path, arguments.times);
  if (trajectory.repeated > 0) {
    console->Message(fmt::format("{}: left out {} whose time is that of the pose before",
                                 path.string(),
                                 Counted(static_cast<size_t>(trajectory.repeated), "pose")));
  }
  return trajectory;
}

bool IsGroundTruthFile(const std::filesystem::path& truth) { return truth.extension() == ".yaml"; }

Truth ReadTruth(const EvaluateArguments& arguments, Console* console) {
  Truth truth;
  if (!arguments.truth.empty()) {
    std::filesystem::path path = arguments.truth;
    if (IsGroundTruthFile(path)) {
      GroundTruthFile file = ReadGroundTruth(path, arguments.camera);
      path = file.segments;
      truth.uncertainty = std::move(file.uncertainty);
    }
    truth.whole = ReadAndReport(path, arguments, console);
    truth.loop = SplitAtLargestGap(truth.whole);
    if (!truth.loop) {
      console->Message(
          fmt::format("{}: no gap stands out, so it is taken for the truth of the whole path; the "
                      "drift over a loop is left out",
                      path.string()));
    }
    return truth;
  }
  truth.loop = {ReadAndReport(arguments.start, arguments, console),
                ReadAndReport(arguments.end, arguments, console)};
  const LoopTruth& loop = *truth.loop;
  if (!loop.start.has_times || !loop.end.has_times) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: KITTI poses have no times, so nothing says which part of the "
                            "path they are; use another form",
                            (loop.start.has_times ? arguments.end : arguments.start).string()));
  }
  if (!(loop.start.times.back() < loop.end.times.front())) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: begins before {} ends; --start and --end may be exchanged",
                            arguments.end.string(),
                            arguments.start.string()));
  }
  truth.whole = loop.start;
  const auto append = [](auto* to, const auto& more) {
    to->insert(to->end(), more.begin(), more.end());
  };
  append(&truth.whole.times, loop.end.times);
  append(&truth.whole.positions, loop.end.positions);
  append(&truth.whole.orientations, loop.end.orientations);
  return truth;
}

/// "NAME=FILE" or a file, which its stem then names.
std::vector<Run> NamedRuns(const EvaluateArguments& arguments) {
  std::vector<Run> runs;
  std::error_code error;
  for (const std::string& text : arguments.estimates) {
    Run run;
    const size_t equals = text.find('=');
    const bool is_file = std::filesystem::exists(text, error);
    run.path = is_file || equals == std::string::npos ? text : text.substr(equals + 1);
    run.name =
        is_file || equals == std::string::npos ? run.path.stem().string() : text.substr(0, equals);
    if (!std::filesystem::exists(run.path, error)) {
      throw Error(ErrorKind::kInput, fmt::format("{}: no such file", run.path.string()));
    }
    const auto same = [&](const Run& other) { return other.name == run.name; };
    if (std::any_of(runs.begin(), runs.end(), same)) {
      throw Error(ErrorKind::kInput,
                  fmt::format("two runs are called '{}'; write --estimate NAME=FILE", run.name));
    }
    runs.push_back(run);
  }
  using MonocularRuns = EvaluateArguments::MonocularRuns;
  if (arguments.monocular_runs == MonocularRuns::kNone) return runs;
  const std::vector<std::string_view> names = NamesOf(runs);
  for (const std::string& name : arguments.monocular) {
    if (std::find(names.begin(), names.end(), name) != names.end()) continue;
    throw Error(ErrorKind::kInput,
                fmt::format("--monocular: no run '{}'{}", name, SuggestName(name, names)));
  }
  for (Run& run : runs) {
    run.monocular = arguments.monocular_runs == MonocularRuns::kAll ||
                    std::ranges::find(arguments.monocular, run.name) != arguments.monocular.end();
  }
  return runs;
}

void Evaluate(const EvaluateArguments& arguments, const Truth& truth, Console* console, Run* run) {
  const Trajectory estimate = ReadAndReport(run->path, arguments, console);
  if (estimate.has_times != truth.whole.has_times) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: KITTI poses have no times; give them with --times FILE",
                            (estimate.has_times ? truth.whole : estimate).path));
  }
  if (truth.loop) run->loop = MeasureLoop(estimate, *truth.loop, arguments.tolerance);
  if (run->loop && truth.uncertainty) {
    run->loop_errors = ErrorsByTruth(*run->loop, estimate, *truth.uncertainty);
  }
  run->errors =
      MeasurePath(estimate, truth.whole, arguments.tolerance, static_cast<size_t>(arguments.delta));
}

Json ToJson(const ErrorStatistics& s) {
  return {{"rmse", s.rmse},
          {"mean", s.mean},
          {"median", s.median},
          {"std", s.std},
          {"min", s.min},
          {"max", s.max},
          {"sse", s.sse}};
}

Json ToJson(const Similarity& T) {
  Json rows = Json::array();
  const Eigen::Matrix4d matrix = T.Matrix();
  for (int r = 0; r < 4; ++r) {
    rows.push_back({matrix(r, 0), matrix(r, 1), matrix(r, 2), matrix(r, 3)});
  }
  return rows;
}

Json ToJson(const MetricError& error) {
  return {{"sigma", error.sigma}, {"floor", error.floor}, {"resolved", error.resolved}};
}

Json ToJson(const LoopMetricErrors& errors, bool monocular) {
  Json json{{"scale_drift", ToJson(errors.scale_drift)},
            {"rotation_drift_deg", ToJson(errors.rotation_drift_deg)},
            {"translation_drift", ToJson(errors.translation_drift)},
            {"alignment_error", ToJson(errors.alignment_error)}};
  if (!monocular) json["absolute_scale"] = ToJson(errors.absolute_scale);
  return json;
}

Json ToJson(const Run& run, const EvaluateArguments& arguments) {
  Json json;
  if (!run.failure.empty()) return {{"failed", run.failure}};
  if (run.loop) {
    const LoopMetrics& loop = *run.loop;
    json["scale_drift"] = loop.ScaleDrift();
    json["scale_drift_folded"] = Folded(loop.ScaleDrift());
    json["rotation_drift_deg"] = loop.rotation_drift_deg;
    json["translation_drift"] = loop.translation_drift;
    json["alignment_error"] = loop.alignment_error;
    json["alignment_error_percent"] = 100 * loop.alignment_error / loop.path_length;
    if (!run.monocular) {
      json["absolute_scale"] = loop.absolute_scale;
      json["absolute_scale_folded"] = Folded(loop.absolute_scale);
      json["scale_min"] = loop.ScaleMin();
      json["scale_max"] = loop.ScaleMax();
    }
    json["path_length"] = loop.path_length;
    json["frames"] = loop.frames;
    json["T_s_gt"] = ToJson(loop.T_s_gt);
    json["T_e_gt"] = ToJson(loop.T_e_gt);
    json["T_drift"] = ToJson(loop.T_drift);
    if (run.loop_errors) json["errors_by_truth"] = ToJson(*run.loop_errors, run.monocular);
  }
  const PathErrors& errors = *run.errors;
  Json ate{{"pairs", errors.pairs}}, rpe{{"delta", arguments.delta}};
  if (!run.monocular) {
    ate["scale"] = errors.scale;
    ate["unaligned"] = ToJson(errors.ate_unaligned);
    ate["se3"] = ToJson(errors.ate_se3);
    rpe["se3"] = ToJson(errors.rpe_se3);
  }
  ate["sim3"] = ToJson(errors.ate_sim3);
  ate["rotation_deg"] = ToJson(errors.ate_rotation);
  rpe["sim3"] = ToJson(errors.rpe_sim3);
  rpe["rotation_deg"] = ToJson(errors.rpe_rotation);
  json["ate"] = ate;
  json["rpe"] = rpe;
  json["tolerance"] = arguments.tolerance;
  return json;
}

/// Columns as wide as their widest cell, the first to the left.
std::string Aligned(const std::vector<std::vector<std::string>>& rows) {
  std::vector<size_t> widths(rows.front().size(), 0);
  for (const auto& row : rows) {
    for (size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  std::string text;
  for (const auto& row : rows) {
    text += fmt::format("{:<{}}", row[0], widths[0]);
    for (size_t i = 1; i < row.size(); ++i) text += fmt::format("  {:>{}}", row[i], widths[i]);
    text += '\n';
  }
  return text;
}

// Marks a value that is below the floor of its metric.
constexpr const char* kNotResolved = "*";

void AddLoopCells(const Run& run, std::vector<std::string>* row) {
  const LoopMetrics& loop = *run.loop;
  const LoopMetricErrors errors = run.loop_errors.value_or(LoopMetricErrors{});
  const auto add = [&](const std::string& value, const MetricError& error) {
    row->push_back(value + (error.resolved ? "" : kNotResolved));
  };
  const auto add_length = [&](double value, const MetricError& error) {
    add(fmt::format("{:.4g}", value), error);
  };
  row->push_back(fmt::format("{}", loop.frames));
  add_length(loop.path_length, {});
  add(fmt::format("{:.5f}", Folded(loop.ScaleDrift())), errors.scale_drift);
  add_length(loop.rotation_drift_deg, errors.rotation_drift_deg);
  add_length(loop.translation_drift, errors.translation_drift);
  add_length(loop.alignment_error, errors.alignment_error);
  add_length(100 * loop.alignment_error / loop.path_length, errors.alignment_error);
  if (run.monocular) {
    row->insert(row->end(), 3, "-");
    return;
  }
  add(fmt::format("{:.5f}", Folded(loop.absolute_scale)), errors.absolute_scale);
  for (const double scale : {loop.ScaleMin(), loop.ScaleMax()}) {
    row->push_back(fmt::format("{:.5f}", scale));
  }
}

// Standard errors of the loop's metrics by those of the truth; empty where they are not known.
std::string TruthErrorTable(const std::vector<Run>& runs) {
  std::vector<std::vector<std::string>> rows{
      {"errors by the truth", "e_s'", "e_r deg", "e_t m", "e_align m", "its floor m", "d_s'"}};
  bool resolved = true;
  for (const Run& run : runs) {
    if (!run.loop_errors) continue;
    const LoopMetricErrors& errors = *run.loop_errors;
    const auto cell = [&](double value) { return fmt::format("{:.2g}", value); };
    rows.push_back({run.name,
                    cell(errors.scale_drift.sigma),
                    cell(errors.rotation_drift_deg.sigma),
                    cell(errors.translation_drift.sigma),
                    cell(errors.alignment_error.sigma),
                    cell(errors.alignment_error.floor),
                    run.monocular ? "-" : cell(errors.absolute_scale.sigma)});
    for (const MetricError* error : {&errors.scale_drift,
                                     &errors.rotation_drift_deg,
                                     &errors.translation_drift,
                                     &errors.alignment_error,
                                     &errors.absolute_scale}) {
      resolved =
          resolved && (error->resolved || (run.monocular && error == &errors.absolute_scale));
    }
  }
  if (rows.size() == 1) return "";
  return "\n" + Aligned(rows) +
         (resolved ? ""
                   : fmt::format("{} not resolved: an estimate without errors has as much by "
                                 "those of the truth\n",
                                 kNotResolved));
}

std::string Table(const std::vector<Run>& runs, const Truth& truth) {
  const bool with_loop = truth.loop.has_value();
  std::vector<std::vector<std::string>> rows{{"run"}};
  if (with_loop) {
    rows[0].insert(rows[0].end(),
                   {"frames",
                    "path m",
                    "e_s'",
                    "e_r deg",
                    "e_t m",
                    "e_align m",
                    "e_align %",
                    "d_s'",
                    "s_min",
                    "s_max"});
  }
  rows[0].insert(rows[0].end(),
                 {"pairs", "ATE m", "ATE scaled m", "RPE m", "RPE scaled m", "RPE deg"});
  std::string failures;
  for (const Run& run : runs) {
    if (!run.failure.empty()) {
      failures += fmt::format("{}  FAILED: {}\n", run.name, run.failure);
      continue;
    }
    std::vector<std::string>& row = rows.emplace_back(1, run.name);
    const auto add = [&](double value, bool needs_scale = false) {
      row.push_back(needs_scale && run.monocular ? "-" : fmt::format("{:.4g}", value));
    };
    if (with_loop) AddLoopCells(run, &row);
    const PathErrors& errors = *run.errors;
    row.push_back(fmt::format("{}", errors.pairs));
    add(errors.ate_se3.rmse, true);
    add(errors.ate_sim3.rmse);
    add(errors.rpe_se3.rmse, true);
    add(errors.rpe_sim3.rmse);
    add(errors.rpe_rotation.rmse);
  }
  return (rows.size() > 1 ? Aligned(rows) + TruthErrorTable(runs) : "") + failures;
}

BarChart ChartOf(const std::vector<Run>& runs, const Truth& truth) {
  BarChart chart;
  for (const Run& run : runs) chart.runs.push_back(run.name);
  const auto panel = [&](const std::string& title, double base, bool needs_scale, auto&& value) {
    BarPanel& added = chart.panels.emplace_back(BarPanel{title, base, {}});
    for (const Run& run : runs) {
      if (needs_scale && run.monocular) {
        added.values.emplace_back();
      } else if (!run.failure.empty()) {
        added.values.emplace_back(std::numeric_limits<double>::infinity());
      } else {
        added.values.emplace_back(value(run));
      }
    }
  };
  if (truth.loop) {
    panel("absolute scale error d_s'", 1, true, [](const Run& run) {
      return Folded(run.loop->absolute_scale);
    });
    panel("scale drift e_s'", 1, false, [](const Run& run) {
      return Folded(run.loop->ScaleDrift());
    });
    panel("alignment error e_align, % of path", 0, false, [](const Run& run) {
      return 100 * run.loop->alignment_error / run.loop->path_length;
    });
  } else {
    panel("ATE, m", 0, true, [](const Run& run) { return run.errors->ate_se3.rmse; });
    panel("ATE with scale, m", 0, false, [](const Run& run) { return run.errors->ate_sim3.rmse; });
    panel("RPE with scale, m", 0, false, [](const Run& run) { return run.errors->rpe_sim3.rmse; });
  }
  return chart;
}

void CheckArguments(const EvaluateArguments& arguments) {
  const bool both_segments = !arguments.start.empty() && !arguments.end.empty();
  const bool any_segment = !arguments.start.empty() || !arguments.end.empty();
  if (!arguments.camera.empty() && !IsGroundTruthFile(arguments.truth)) {
    throw Error(ErrorKind::kInput,
                "--camera chooses one of the cameras of --truth groundtruth.yaml; other files of "
                "the truth hold one path only");
  }
  if (arguments.truth.empty() ? both_segments : !any_segment) return;
  throw Error(ErrorKind::kInput,
              "give the truth either by --truth FILE or by --start FILE and --end FILE");
}

/// Measures all runs. Beside others a failed run is a result.
void EvaluateAll(const EvaluateArguments& arguments,
                 const Truth& truth,
                 Console* console,
                 std::vector<Run>* runs) {
  for (Run& run : *runs) {
    console->Progress("evaluate " + run.name);
    try {
      Evaluate(arguments, truth, console, &run);
    } catch (const Error& error) {
      if (runs->size() == 1) throw;
      run.failure = error.what();
    }
    if (Interrupted()) throw Stopped();
  }
  if (std::ranges::any_of(*runs, [](const Run& run) { return run.failure.empty(); })) return;
  throw Error(ErrorKind::kJob,
              fmt::format("all runs failed; the first: {}", runs->front().failure));
}

void PrintJson(const EvaluateArguments& arguments, const std::vector<Run>& runs) {
  Json json;
  if (runs.size() == 1) {
    json = ToJson(runs[0], arguments);
  } else {
    for (const Run& run : runs) json["runs"][run.name] = ToJson(run, arguments);
  }
  fmt::print("{}\n", json.dump(2, ' ', false, Json::error_handler_t::replace));
}

void RunEvaluate(const EvaluateArguments& arguments, const ConsoleOptions& shared) {
  Console console(shared);
  CheckArguments(arguments);
  std::optional<PictureFormat> format;
  if (!arguments.chart.empty()) format = PictureFormatOf(arguments.chart);
  std::vector<Run> runs = NamedRuns(arguments);
  const Truth truth = ReadTruth(arguments, &console);
  EvaluateAll(arguments, truth, &console, &runs);
  if (format) WriteOutput(arguments.chart, DrawBarChart(ChartOf(runs, truth), *format));
  if (arguments.json) {
    PrintJson(arguments, runs);
  } else {
    fmt::print("{}", Table(runs, truth));
  }
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
                                      ? EvaluateArguments::MonocularRuns::kAll
                                      : EvaluateArguments::MonocularRuns::kListed;
    }
    RunEvaluate(*arguments, *shared);
  };
}

}  // namespace

Command EvaluateCommand() { return {"evaluate", kEvaluateHelp, DeclareEvaluate}; }

}  // namespace plenocal
