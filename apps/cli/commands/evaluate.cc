// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <variant>

#include "apps/commands.h"
#include "apps/evaluate/trajectory_metrics.h"
#include "apps/image_module.h"
#include "calib/error.h"
#include "calib/names.h"
#include "calib/output_folder.h"

namespace plenocal {
namespace {

using Json = nlohmann::ordered_json;

/// The truth of all runs.
struct Truth {
  Trajectory whole;               ///< both segments, when there are two
  std::optional<LoopTruth> loop;  ///< nothing: the truth covers the whole path
};

/// One run of an algorithm: what was measured, or why nothing could be.
struct Run {
  std::string name;
  std::filesystem::path path;
  bool monocular = false;
  std::optional<LoopMetrics> loop;
  std::optional<PathErrors> errors;
  std::string failure;
};

Trajectory ReadAndReport(const std::filesystem::path& path,
                         const EvaluateCommand& command,
                         Console* console) {
  Trajectory trajectory = ReadTrajectory(path, command.times);
  if (trajectory.repeated > 0) {
    console->Message(fmt::format("{}: left out {} poses whose time is that of the pose before",
                                 path.string(),
                                 trajectory.repeated));
  }
  return trajectory;
}

Truth ReadTruth(const EvaluateCommand& command, Console* console) {
  Truth truth;
  if (!command.truth.empty()) {
    truth.whole = ReadAndReport(command.truth, command, console);
    truth.loop = SplitAtLargestGap(truth.whole);
    if (!truth.loop) {
      console->Message(
          fmt::format("{}: no gap stands out, so it is taken for the truth of the whole path; the "
                      "drift over a loop is left out",
                      command.truth.string()));
    }
    return truth;
  }
  truth.loop = {ReadAndReport(command.start, command, console),
                ReadAndReport(command.end, command, console)};
  const LoopTruth& loop = *truth.loop;
  if (!loop.start.has_times || !loop.end.has_times) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: KITTI poses have no times, so nothing says which part of the path "
                            "they are; use another form",
                            (loop.start.has_times ? command.end : command.start).string()));
  }
  if (!(loop.start.times.back() < loop.end.times.front())) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: begins before {} ends; --start and --end may be exchanged",
                            command.end.string(),
                            command.start.string()));
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
std::vector<Run> NamedRuns(const EvaluateCommand& command) {
  std::vector<Run> runs;
  std::error_code error;
  for (const std::string& text : command.estimates) {
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
  if (!command.monocular) return runs;
  const std::vector<std::string_view> names = NamesOf(runs);
  for (const std::string& name : *command.monocular) {
    if (std::find(names.begin(), names.end(), name) != names.end()) continue;
    throw Error(ErrorKind::kInput,
                fmt::format("--monocular: no run '{}'{}", name, SuggestName(name, names)));
  }
  for (Run& run : runs) {
    run.monocular = command.monocular->empty() ||
                    std::find(command.monocular->begin(), command.monocular->end(), run.name) !=
                        command.monocular->end();
  }
  return runs;
}

void Evaluate(const EvaluateCommand& command, const Truth& truth, Console* console, Run* run) {
  const Trajectory estimate = ReadAndReport(run->path, command, console);
  if (estimate.has_times != truth.whole.has_times) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: KITTI poses have no times; give them with --times FILE",
                            (estimate.has_times ? truth.whole : estimate).path));
  }
  if (truth.loop) run->loop = MeasureLoop(estimate, *truth.loop, command.tolerance);
  run->errors =
      MeasurePath(estimate, truth.whole, command.tolerance, static_cast<size_t>(command.delta));
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

Json ToJson(const Run& run, const EvaluateCommand& command) {
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
  }
  const PathErrors& errors = *run.errors;
  Json ate{{"pairs", errors.pairs}}, rpe{{"delta", command.delta}};
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
  json["tolerance"] = command.tolerance;
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

std::string Table(const std::vector<Run>& runs, bool with_loop) {
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
    if (with_loop) {
      const LoopMetrics& loop = *run.loop;
      row.push_back(fmt::format("{}", loop.frames));
      add(loop.path_length);
      row.push_back(fmt::format("{:.5f}", Folded(loop.ScaleDrift())));
      add(loop.rotation_drift_deg);
      add(loop.translation_drift);
      add(loop.alignment_error);
      add(100 * loop.alignment_error / loop.path_length);
      for (const double scale : {Folded(loop.absolute_scale), loop.ScaleMin(), loop.ScaleMax()}) {
        row.push_back(run.monocular ? "-" : fmt::format("{:.5f}", scale));
      }
    }
    const PathErrors& errors = *run.errors;
    row.push_back(fmt::format("{}", errors.pairs));
    add(errors.ate_se3.rmse, true);
    add(errors.ate_sim3.rmse);
    add(errors.rpe_se3.rmse, true);
    add(errors.rpe_sim3.rmse);
    add(errors.rpe_rotation.rmse);
  }
  return (rows.size() > 1 ? Aligned(rows) : "") + failures;
}

BarChart ChartOf(const std::vector<Run>& runs, bool with_loop) {
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
  if (with_loop) {
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

PictureFormat FormatOf(const std::filesystem::path& chart) {
  if (chart.extension() == ".svg") return PictureFormat::kSvg;
  if (chart.extension() == ".png") return PictureFormat::kPng;
  throw Error(ErrorKind::kInput,
              fmt::format("--chart {}: name a .svg or .png file", chart.string()));
}

}  // namespace

void RunEvaluate(const EvaluateCommand& command, const ConsoleOptions& options) {
  Console console(options.quiet);
  if (command.truth.empty() == (command.start.empty() && command.end.empty()) ||
      command.start.empty() != command.end.empty()) {
    throw Error(ErrorKind::kInput,
                "give the truth either by --truth FILE or by --start FILE and --end FILE");
  }
  std::optional<PictureFormat> format;
  if (!command.chart.empty()) format = FormatOf(command.chart);
  std::vector<Run> runs = NamedRuns(command);
  const Truth truth = ReadTruth(command, &console);
  size_t failed = 0;
  for (Run& run : runs) {
    console.Progress("evaluate " + run.name);
    try {
      Evaluate(command, truth, &console, &run);
    } catch (const Error& error) {
      // Beside others a failed run is a result.
      if (runs.size() == 1) throw;
      run.failure = error.what();
      ++failed;
    }
    if (Interrupted()) throw Stopped();
  }
  if (failed == runs.size()) {
    throw Error(ErrorKind::kJob, fmt::format("all runs failed; the first: {}", runs[0].failure));
  }

  if (format) {
    const std::filesystem::path folder = command.chart.parent_path();
    OutputFolder output(folder.empty() ? "." : folder);
    output.Write(command.chart.filename().string(),
                 DrawBarChartByModule(ChartOf(runs, truth.loop.has_value()), *format));
    output.Commit();
  }
  if (!command.json) {
    fmt::print("{}", Table(runs, truth.loop.has_value()));
    return;
  }
  Json json;
  if (runs.size() == 1) {
    json = ToJson(runs[0], command);
  } else {
    for (const Run& run : runs) json["runs"][run.name] = ToJson(run, command);
  }
  fmt::print("{}\n", json.dump(2, ' ', false, Json::error_handler_t::replace));
}

}  // namespace plenocal
