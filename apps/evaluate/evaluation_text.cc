// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>

#include "apps/evaluate/evaluate_runs.h"

namespace plenocal {
namespace {

using Json = nlohmann::ordered_json;

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

Json ToJson(const EvaluatedRun& run, const Evaluation& evaluation) {
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
  Json ate{{"pairs", errors.pairs}}, rpe{{"delta", evaluation.delta}};
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
  json["tolerance"] = evaluation.tolerance;
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

void AddLoopCells(const EvaluatedRun& run, std::vector<std::string>* row) {
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
std::string TruthErrorTable(const std::vector<EvaluatedRun>& runs) {
  std::vector<std::vector<std::string>> rows{
      {"errors by the truth", "e_s'", "e_r deg", "e_t m", "e_align m", "its floor m", "d_s'"}};
  bool resolved = true;
  for (const EvaluatedRun& run : runs) {
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

}  // namespace

std::string EvaluationText(const Evaluation& evaluation) {
  const auto& runs = evaluation.runs;
  std::vector<std::vector<std::string>> rows{{"run"}};
  if (evaluation.has_loop) {
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
  for (const EvaluatedRun& run : runs) {
    if (!run.failure.empty()) {
      failures += fmt::format("{}  FAILED: {}\n", run.name, run.failure);
      continue;
    }
    std::vector<std::string>& row = rows.emplace_back(1, run.name);
    const auto add = [&](double value, bool needs_scale = false) {
      row.push_back(needs_scale && run.monocular ? "-" : fmt::format("{:.4g}", value));
    };
    if (evaluation.has_loop) AddLoopCells(run, &row);
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

Json EvaluationJson(const Evaluation& evaluation) {
  if (evaluation.runs.size() == 1) return ToJson(evaluation.runs[0], evaluation);
  Json json;
  for (const EvaluatedRun& run : evaluation.runs) json["runs"][run.name] = ToJson(run, evaluation);
  return json;
}

}  // namespace plenocal
