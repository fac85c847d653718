// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <gmock/gmock.h>

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
