// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <string>
#include <vector>

#include "apps/evaluate/evaluate_runs.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

PathErrors Errors() {
  PathErrors errors{};
  errors.pairs = 40;
  errors.ate_se3.rmse = 0.5;
  errors.ate_sim3.rmse = 0.25;
  errors.rpe_se3.rmse = 0.125;
  errors.rpe_sim3.rmse = 0.0625;
  errors.rpe_rotation.rmse = 3;
  return errors;
}

EvaluatedRun RunOf(const char* name) {
  EvaluatedRun run;
  run.name = name;
  run.errors = Errors();
  return run;
}

LoopMetrics Loop() {
  LoopMetrics loop{};
  loop.T_s_gt.s = 1.5;
  loop.T_e_gt.s = 1.25;
  loop.T_drift.s = 0.8;
  loop.rotation_drift_deg = 2.5;
  loop.translation_drift = 0.75;
  loop.alignment_error = 1.5;
  loop.absolute_scale = 0.5;
  loop.path_length = 60;
  loop.frames = 41;
  return loop;
}

// The cells of a line of the table; two blanks and more are between them.
std::vector<std::string> Cells(const std::string& line) {
  static const std::regex kBetween(" {2,}");
  return {std::sregex_token_iterator(line.begin(), line.end(), kBetween, -1), {}};
}

TEST(EvaluationText, HasACellOfEachMetric) {
  Evaluation evaluation;
  evaluation.has_loop = true;
  EvaluatedRun run = RunOf("run");
  run.loop = Loop();
  evaluation.runs.push_back(run);
  run.name = "monocular";
  run.monocular = true;
  evaluation.runs.push_back(run);
  evaluation.runs.emplace_back().name = "lost";
  evaluation.runs.back().failure = "no poses";
  const std::vector<std::string> lines = Lines(EvaluationText(evaluation));
  ASSERT_EQ(lines.size(), 4U);
  EXPECT_THAT(Cells(lines[0]),
              ElementsAre("run",
                          "frames",
                          "path m",
                          "e_s'",
                          "e_r deg",
                          "e_t m",
                          "e_align m",
                          "e_align %",
                          "d_s'",
                          "s_min",
                          "s_max",
                          "pairs",
                          "ATE m",
                          "ATE scaled m",
                          "RPE m",
                          "RPE scaled m",
                          "RPE deg"));
  EXPECT_THAT(Cells(lines[1]),
              ElementsAre("run",
                          "41",
                          "60",
                          "1.25000",
                          "2.5",
                          "0.75",
                          "1.5",
                          "2.5",
                          "2.00000",
                          fmt::format("{:.5f}", Loop().ScaleMin()),
                          fmt::format("{:.5f}", Loop().ScaleMax()),
                          "40",
                          "0.5",
                          "0.25",
                          "0.125",
                          "0.0625",
                          "3"));
  // A monocular run has no scale.
  EXPECT_THAT(Cells(lines[2]),
              ElementsAre("monocular",
                          "41",
                          "60",
                          "1.25000",
                          "2.5",
                          "0.75",
                          "1.5",
                          "2.5",
                          "-",
                          "-",
                          "-",
                          "40",
                          "-",
                          "0.25",
                          "-",
                          "0.0625",
                          "3"));
  EXPECT_EQ(lines[3], "lost  FAILED: no poses");
}

// Numbers of a JSON object by their keys, "a.b" of an object in it; of statistics the rmse.
std::map<std::string, double> NumbersIn(const nlohmann::ordered_json& json,
                                        const std::string& prefix = "") {
  std::map<std::string, double> numbers;
  for (const auto& [key, value] : json.items()) {
    if (value.is_number()) numbers[prefix + key] = value.get<double>();
    if (value.is_boolean()) numbers[prefix + key] = value.get<bool>() ? 1 : 0;
    if (value.contains("rmse")) {
      numbers[prefix + key] = value["rmse"].get<double>();
    } else if (value.is_object()) {
      numbers.merge(NumbersIn(value, prefix + key + "."));
    }
  }
  return numbers;
}

TEST(EvaluationJson, HasAllMetricsOfARun) {
  Evaluation evaluation{.runs = {RunOf("run")}, .has_loop = true, .tolerance = 0.01, .delta = 3};
  EvaluatedRun& run = evaluation.runs[0];
  run.errors->scale = 1.0625;
  run.errors->ate_unaligned.rmse = 4;
  run.errors->ate_rotation.rmse = 5;
  run.loop = Loop();
  run.loop_errors.emplace();
  run.loop_errors->translation_drift = {.sigma = 0.5, .floor = 1.5, .resolved = false};
  const nlohmann::ordered_json json = EvaluationJson(evaluation);
  const std::map<std::string, double> with_scale{{"ate.se3", 0.5},
                                                 {"ate.unaligned", 4},
                                                 {"ate.scale", 1.0625},
                                                 {"rpe.se3", 0.125},
                                                 {"absolute_scale", 0.5},
                                                 {"absolute_scale_folded", 2},
                                                 {"scale_min", 0.5 / std::sqrt(1.25)},
                                                 {"scale_max", 0.5 * std::sqrt(1.25)},
                                                 {"errors_by_truth.absolute_scale.sigma", 0},
                                                 {"errors_by_truth.absolute_scale.floor", 0},
                                                 {"errors_by_truth.absolute_scale.resolved", 1}};
  std::map<std::string, double> expected{{"ate.pairs", 40},
                                         {"ate.sim3", 0.25},
                                         {"ate.rotation_deg", 5},
                                         {"rpe.delta", 3},
                                         {"rpe.sim3", 0.0625},
                                         {"rpe.rotation_deg", 3},
                                         {"tolerance", 0.01},
                                         {"scale_drift", 0.8},
                                         {"scale_drift_folded", 1.25},
                                         {"rotation_drift_deg", 2.5},
                                         {"translation_drift", 0.75},
                                         {"alignment_error", 1.5},
                                         {"alignment_error_percent", 2.5},
                                         {"path_length", 60},
                                         {"frames", 41}};
  for (const char* metric :
       {"scale_drift", "rotation_drift_deg", "translation_drift", "alignment_error"}) {
    const std::string key = std::string("errors_by_truth.") + metric;
    const bool is_set = key.ends_with("translation_drift");
    expected[key + ".sigma"] = is_set ? 0.5 : 0;
    expected[key + ".floor"] = is_set ? 1.5 : 0;
    expected[key + ".resolved"] = is_set ? 0 : 1;
  }
  run.monocular = true;
  EXPECT_EQ(NumbersIn(EvaluationJson(evaluation)), expected);
  expected.insert(with_scale.begin(), with_scale.end());
  EXPECT_EQ(NumbersIn(json), expected);
  EXPECT_EQ(json["T_s_gt"][0][0], 1.5);
  EXPECT_EQ(json["T_e_gt"][1][1], 1.25);
  EXPECT_EQ(json["T_drift"][2][2], 0.8);
  EXPECT_EQ(json["T_drift"][3][3], 1);
  const nlohmann::ordered_json statistics = json["ate"]["se3"];
  for (const char* key : {"rmse", "mean", "median", "std", "min", "max", "sse"}) {
    EXPECT_TRUE(statistics.contains(key)) << key;
  }
  // Of several runs, by name; a failed one has its reason.
  evaluation.runs.push_back(RunOf("other"));
  evaluation.runs[1].failure = "no poses";
  const nlohmann::ordered_json both = EvaluationJson(evaluation);
  EXPECT_EQ(both["runs"]["other"]["failed"], "no poses");
  EXPECT_EQ(both["runs"]["run"]["frames"], 41);
}

TEST(EvaluationText, MarksWhatTheTruthDoesNotResolve) {
  Evaluation evaluation;
  evaluation.has_loop = true;
  LoopMetricErrors errors{};
  for (MetricError* error : {&errors.scale_drift,
                             &errors.rotation_drift_deg,
                             &errors.translation_drift,
                             &errors.alignment_error,
                             &errors.absolute_scale}) {
    *error = {.sigma = 0.5, .floor = 0.25, .resolved = true};
  }
  evaluation.runs.push_back(RunOf("run"));
  evaluation.runs[0].loop = Loop();
  evaluation.runs[0].loop_errors = errors;
  EXPECT_THAT(EvaluationText(evaluation), Not(HasSubstr("*")));
  evaluation.runs[0].loop_errors->translation_drift.resolved = false;
  const std::string text = EvaluationText(evaluation);
  EXPECT_THAT(text, HasSubstr(" 0.75*  "));
  EXPECT_THAT(text, HasSubstr("\n* not resolved: "));
  EXPECT_THAT(Cells(Lines(text)[4]), ElementsAre("run", "0.5", "0.5", "0.5", "0.5", "0.25", "0.5"));
  // The absolute scale of a monocular run does not count.
  evaluation.runs[0].monocular = true;
  evaluation.runs[0].loop_errors->translation_drift.resolved = true;
  evaluation.runs[0].loop_errors->absolute_scale.resolved = false;
  EXPECT_THAT(EvaluationText(evaluation), Not(HasSubstr("*")));
}

TEST(EvaluationText, HasNoCellsOfALoopWithoutOne) {
  Evaluation evaluation;
  evaluation.runs.push_back(RunOf("run"));
  const std::vector<std::string> lines = Lines(EvaluationText(evaluation));
  ASSERT_EQ(lines.size(), 2U);
  EXPECT_THAT(lines[0], StartsWith("run  pairs  ATE m"));
  EXPECT_THAT(Cells(lines[1]), ElementsAre("run", "40", "0.5", "0.25", "0.125", "0.0625", "3"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
