// SPDX-License-Identifier: Apache-2.0
//
// Where results go: folders that cannot be written, full disks, earlier results, inputs.
#include <fmt/format.h>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

class Output : public Workspace {
 protected:
  Output() { WriteProblem(EasyProblem()); }

  [[nodiscard]] Outcome RunInto(const std::string& out, const RunOptions& options = {}) const {
    return Run({"calibrate", "session.yaml", "-o", out, "--quiet"}, options);
  }
};

TEST_F(Output, BelowAFileIsRefusedAndTheFileKept) {
  Write("file", "precious");
  for (const std::string out : {"file/out", "file", "/dev/null/out"}) {
    const Outcome outcome = RunInto(out);
    EXPECT_EQ(outcome.status, kJobFailed);
    EXPECT_THAT(outcome.err, HasSubstr(out));
    EXPECT_THAT(outcome.err, HasSubstr("output folder"));
    EXPECT_EQ(outcome.out, "");
  }
  EXPECT_EQ(Read("file"), "precious");
}

TEST_F(Output, FoldersAreMadeWithTheirParents) {
  EXPECT_EQ(RunInto("a/b/c").status, kDone);
  EXPECT_TRUE(fs::exists(Path("a/b/c/calibration.yaml")));
}

TEST_F(Output, OnAFullDiskLeavesNothing) {
  const Outcome outcome = RunInto("a/b", {.file_size_limit = 8192});
  EXPECT_EQ(outcome.status, kJobFailed);
  EXPECT_THAT(outcome.err, HasSubstr("a/b/"));
  EXPECT_THAT(outcome.err, HasSubstr("cannot be written"));
  EXPECT_FALSE(fs::exists(Path("a")));
}

TEST_F(Output, OnAFullDiskKeepsEarlierResults) {
  EXPECT_EQ(RunInto("out").status, kDone);
  const auto before = Files("out");
  Write("session.yaml", Replaced(Read("session.yaml"), "huber", "cauchy"));
  EXPECT_EQ(RunInto("out", {.file_size_limit = 8192}).status, kJobFailed);
  EXPECT_EQ(Files("out"), before);
}

TEST_F(Output, WithAFolderInAResultsPlaceIsRefusedAndNothingReplaced) {
  EXPECT_EQ(RunInto("out").status, kDone);
  fs::remove(Path("out/residuals.csv"));
  fs::create_directory(Path("out/residuals.csv"));
  Write("out/calibration.yaml", "earlier");
  const Outcome outcome = RunInto("out");
  EXPECT_EQ(outcome.status, kJobFailed);
  EXPECT_THAT(outcome.err, HasSubstr("out/residuals.csv"));
  EXPECT_EQ(Read("out/calibration.yaml"), "earlier");
  for (const auto& [name, text] : Files("out")) EXPECT_FALSE(name.starts_with(".partial")) << name;
}

TEST_F(Output, OfASecondRunReplacesTheFirst) {
  EXPECT_EQ(RunInto("out").status, kDone);
  Write("out/calibration.yaml", "earlier");
  Write("out/notes.txt", "the user's own");
  EXPECT_EQ(RunInto("out").status, kDone);
  EXPECT_EQ(Result()["plenocal"].as<int>(), 1);
  EXPECT_EQ(Read("out/notes.txt"), "the user's own");
}

TEST_F(Output, NeverReplacesAnInput) {
  const auto before = Files("");
  const Outcome outcome = RunInto(".");
  EXPECT_EQ(outcome.status, kWrongInput);
  EXPECT_THAT(outcome.err, HasSubstr("target.yaml"));
  EXPECT_THAT(outcome.err, HasSubstr("-o"));
  EXPECT_EQ(Files(""), before);
}

TEST_F(Output, KeepsDetectionsThatAlreadyLieThere) {
  Write("out/detections_cam0.csv", Read("cam0.csv"));
  Write("session.yaml", Replaced(Read("session.yaml"), "cam0.csv", "out/detections_cam0.csv"));
  EXPECT_EQ(RunInto("out").status, kDone);
  EXPECT_EQ(Read("out/detections_cam0.csv"), Read("cam0.csv"));
}

TEST_F(Output, IsTheSameForTheSameInput) {
  WriteProblem(EasyProblem(2, 2e-4));
  // The command is part of the result, so both runs write to one place.
  std::vector<std::map<std::string, std::string>> runs;
  for (const char* threads : {"1", "1", "2"}) {
    const Outcome outcome =
        Run({"calibrate", "session.yaml", "-o", "out", "--threads", threads, "--quiet"});
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    runs.push_back(Files("out"));
    EXPECT_EQ(runs.back(), runs.front());
  }
  EXPECT_EQ(runs[0].count("calibration.yaml"), 1U);
}

TEST_F(Output, OnAFullStandardOutputFails) {
  const Outcome outcome =
      Run({"calibrate", "session.yaml", "-o", "out"}, {.stdout_path = "/dev/full"});
  EXPECT_EQ(outcome.status, kJobFailed);
  EXPECT_THAT(outcome.err, HasSubstr("standard output"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
