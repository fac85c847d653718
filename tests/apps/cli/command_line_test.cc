// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::MatchesRegex;

class CommandLine : public Workspace {
 protected:
  void ExpectRefused(const std::vector<std::string>& arguments,
                     const std::vector<std::string>& parts) const {
    const Outcome outcome = Run(arguments);
    EXPECT_EQ(outcome.status, kWrongInput) << outcome.err;
    EXPECT_EQ(outcome.out, "");
    EXPECT_EQ(Lines(outcome.err).size(), 1U) << outcome.err;
    for (const std::string& part : parts) EXPECT_THAT(outcome.err, HasSubstr(part));
    EXPECT_TRUE(Files("").empty());
  }
};

TEST_F(CommandLine, WithoutArgumentsPointsToTheHelp) {
  ExpectRefused({}, {"ubcommand is required", "plenocal --help"});
}

TEST_F(CommandLine, AnUnknownCommandGetsTheNearestKnownOne) {
  ExpectRefused({"calibrat", "session.yaml", "-o", "out"}, {"calibrat", "'calibrate'", "--help"});
}

TEST_F(CommandLine, AnUnknownOptionIsNamed) {
  ExpectRefused({"calibrate", "session.yaml", "-o", "out", "--fast"}, {"--fast", "--help"});
}

TEST_F(CommandLine, SessionAndOutputAreRequired) {
  ExpectRefused({"calibrate"}, {"session", "required"});
  ExpectRefused({"calibrate", "session.yaml"}, {"--out", "required"});
}

TEST_F(CommandLine, ThreadsAreAtLeastOne) {
  for (const char* threads : {"0", "-1", "many", "1.5"}) {
    ExpectRefused({"calibrate", "session.yaml", "-o", "out", "--threads", threads},
                  {"--threads", threads});
  }
}

TEST_F(CommandLine, HelpGoesToStandardOutput) {
  const Outcome help = Run({"--help"});
  EXPECT_EQ(help.status, kDone);
  EXPECT_EQ(help.err, "");
  EXPECT_THAT(help.out, AllOf(HasSubstr("calibrate"), HasSubstr("detect"), HasSubstr("models")));
  for (const char* command : {"calibrate", "detect", "models"}) {
    const Outcome own = Run({command, "--help"});
    EXPECT_EQ(own.status, kDone);
    EXPECT_EQ(own.err, "");
    EXPECT_THAT(own.out, HasSubstr("Usage: plenocal " + std::string(command)));
  }
  EXPECT_THAT(Run({"calibrate", "--help"}).out,
              AllOf(HasSubstr("--out"), HasSubstr("--threads"), HasSubstr("--quiet")));
}

TEST_F(CommandLine, VersionIsOneLine) {
  const Outcome version = Run({"--version"});
  EXPECT_EQ(version.status, kDone);
  EXPECT_THAT(version.out, MatchesRegex("[0-9]+\\.[0-9]+\\.[0-9]+\n"));
}

TEST_F(CommandLine, ModelsListsParametersWithUnits) {
  const Outcome models = Run({"models"});
  EXPECT_EQ(models.status, kDone);
  EXPECT_EQ(models.err, "");
  EXPECT_THAT(models.out,
              AllOf(HasSubstr("pinhole-radial3\n"),
                    HasSubstr("f_x [px]"),
                    HasSubstr("c_y [px]"),
                    HasSubstr("A_2 [1]"),
                    HasSubstr("source")));
}

TEST_F(CommandLine, ModelsToAFullDiskFails) {
  const Outcome models = Run({"models"}, {.stdout_path = "/dev/full"});
  EXPECT_EQ(models.status, kJobFailed);
  EXPECT_THAT(models.err, HasSubstr("standard output"));
}

TEST_F(CommandLine, QuietLeavesStandardErrorEmpty) {
  WriteProblem(EasyProblem());
  const Outcome quiet = Run({"calibrate", "session.yaml", "-o", "out", "--quiet"});
  EXPECT_EQ(quiet.status, kDone);
  EXPECT_EQ(quiet.err, "");
  EXPECT_THAT(quiet.out, HasSubstr("RMS"));
}

TEST_F(CommandLine, MessagesWithoutATerminalHoldNoControlCharacters) {
  WriteProblem(EasyProblem());
  const Outcome outcome = Calibrate();
  EXPECT_THAT(outcome.err, HasSubstr("cam0: 10 frames"));
  EXPECT_EQ(outcome.err.find_first_of("\r\033"), std::string::npos);
}

}  // namespace
}  // namespace plenocal::testing
