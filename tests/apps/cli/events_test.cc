// SPDX-License-Identifier: Apache-2.0
//
// What programs that run `plenocal` use: --events and --exclude.
#include <nlohmann/json.hpp>

#include "tests/apps/chessboard_images.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

using EventsOption = Workspace;

std::vector<nlohmann::json> EventsOf(const Outcome& outcome) {
  std::vector<nlohmann::json> events;
  for (const std::string& line : Lines(outcome.err)) events.push_back(nlohmann::json::parse(line));
  return events;
}

TEST_F(EventsOption, WritesProgressAndMessagesAsJsonLines) {
  WriteProblem(EasyProblem());
  const Outcome outcome =
      Run({"calibrate", "session.yaml", "-o", "out", "--quiet", "--no-report", "--events", "2"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  int stages = 0, messages = 0;
  for (const nlohmann::json& event : EventsOf(outcome)) {
    if (event["event"] == "progress") stages += event["stage"].get<std::string>().empty() ? 0 : 1;
    if (event["event"] == "message") ++messages;
  }
  EXPECT_GT(stages, 2);
  EXPECT_GT(messages, 0);
}

TEST_F(EventsOption, RefusesAFileThatIsNotOpen) {
  WriteProblem(EasyProblem());
  const Outcome outcome = Run({"detect", "session.yaml", "-o", "out", "--events", "77"});
  EXPECT_EQ(outcome.status, kWrongInput);
  EXPECT_THAT(outcome.err, HasSubstr("--events 77"));
}

using EventsOfImages = Images;

TEST_F(EventsOfImages, TellWhatWasFoundInEach) {
  Save("images/99.png", cv::Mat(480, 640, CV_8UC1, cv::Scalar(128)));
  const Outcome outcome =
      Run({"detect", "session.yaml", "-o", "out", "--quiet", "--cache", "cache", "--events", "2"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  std::map<std::string, nlohmann::json> found;
  for (const nlohmann::json& event : EventsOf(outcome)) {
    if (event["event"] == "detection") found[event["frame"]] = event;
  }
  ASSERT_EQ(found.size(), kImages + 1u) << outcome.err;
  EXPECT_EQ(found["00"]["points"], kColumns * kRows);
  EXPECT_EQ(found["00"]["camera"], "cam0");
  EXPECT_EQ(found["99"]["points"], 0);
  EXPECT_NE(found["99"]["why"], "");
  EXPECT_FALSE(std::filesystem::exists(Path("out/.cache")));
  const Outcome again = Run({"detect", "session.yaml", "-o", "other", "--cache", "cache"});
  EXPECT_THAT(again.err, HasSubstr("detections of 9 images reused"));
}

TEST_F(EventsOption, IsNoReasonToFailWhenNobodyReads) {
  WriteProblem(EasyProblem());
  const Outcome outcome = Run({"detect", "session.yaml", "-o", "out", "--quiet", "--events", "2"},
                              {.stderr_path = "/dev/full"});
  EXPECT_EQ(outcome.status, kDone);
}

using ExcludeOption = Workspace;

TEST_F(ExcludeOption, LeavesOutFramesAsTheSessionDoes) {
  const SyntheticProblem problem = EasyProblem();
  WriteProblem(problem);
  ASSERT_EQ(Run({"calibrate",
                 "session.yaml",
                 "-o",
                 "by_option",
                 "--no-report",
                 "--exclude",
                 "frame: '0003', note: blurred",
                 "--exclude",
                 "markers: [5]"})
                .status,
            kDone);
  Write(
      "session.yaml",
      Read("session.yaml") + "exclude:\n  - {frame: '0003', note: blurred}\n  - {markers: [5]}\n");
  ASSERT_EQ(Run({"calibrate", "session.yaml", "-o", "by_session", "--no-report"}).status, kDone);
  EXPECT_EQ(Read("by_option/residuals.csv"), Read("by_session/residuals.csv"));
  EXPECT_EQ(Read("by_option/left_out.csv"), Read("by_session/left_out.csv"));
  EXPECT_THAT(Read("by_option/left_out.csv"), HasSubstr("excluded by the session: blurred"));
  EXPECT_THAT(Table(Read("by_option/residuals.csv")).Column("frame"), Not(Contains("0003")));
}

TEST_F(ExcludeOption, RefusesRulesWithTheRuleInTheMessage) {
  WriteProblem(EasyProblem());
  const Outcome unknown = Run({"calibrate", "session.yaml", "-o", "out", "--exclude", "fram: '1'"});
  EXPECT_EQ(unknown.status, kWrongInput);
  EXPECT_THAT(unknown.err, HasSubstr("--exclude \"fram: '1'\""));
  const Outcome camera =
      Run({"calibrate", "session.yaml", "-o", "out", "--exclude", "camera: cam9, frame: '1'"});
  EXPECT_EQ(camera.status, kWrongInput);
  EXPECT_THAT(camera.err, HasSubstr("did you mean 'cam0'"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
