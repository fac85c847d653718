// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <pty.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <sstream>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::MatchesRegex;
using ::testing::Not;
using ::testing::StartsWith;

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
  ExpectRefused({"calibrate", "-o", "out"}, {"session.yaml", "--target"});
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

TEST_F(CommandLine, VersionNamesTheCommitAndTheLibraries) {
  const Outcome version = Run({"--version"});
  EXPECT_EQ(version.status, kDone);
  const std::vector<std::string> lines = Lines(version.out);
  ASSERT_GT(lines.size(), 5U);
  EXPECT_THAT(
      lines[0],
      MatchesRegex("plenocal [0-9]+\\.[0-9]+\\.[0-9]+ \\(commit ([0-9a-f]+\\+?|unknown)\\)"));
  for (const char* library : {"Ceres", "Eigen3", "OpenCV", "yaml-cpp"}) {
    EXPECT_THAT(lines, Contains(MatchesRegex(fmt::format("  {} [0-9.]+", library))));
  }
}

TEST_F(CommandLine, HelpCommandPrintsWhatTheOptionPrints) {
  EXPECT_EQ(Run({"help"}).out, Run({"--help"}).out);
  EXPECT_EQ(Run({"help", "calibrate"}).out, Run({"calibrate", "--help"}).out);
  EXPECT_EQ(Run({"help", "models", "check"}).out, Run({"models", "check", "--help"}).out);
  ExpectRefused({"help", "calibrat"}, {"'calibrat'", "did you mean 'calibrate'?"});
}

TEST_F(CommandLine, AnUnknownOptionGetsTheNearestKnownOne) {
  ExpectRefused({"try", "session.yaml", "--modle", "pinhole", "-o", "out"},
                {"'--modle'", "did you mean '--models'?", "plenocal try --help"});
  // What else would be missing is not what the user has to correct.
  ExpectRefused({"calibrate", "session.yaml", "--oot=out"}, {"'--oot'", "did you mean '--out'?"});
  ExpectRefused({"--versoin"}, {"'--versoin'", "did you mean '--version'?"});
  ExpectRefused({"models", "check", "--hepl"}, {"'--hepl'", "did you mean '--help'?"});
}

TEST_F(CommandLine, BashCompletesCommandsOptionsAndValues) {
  Write("completion.bash", Run({"completion", "bash"}).out);
  const auto completed = [&](const std::string& words) {
    const std::string command = fmt::format(
        "cd '{}' && bash -c 'source ./completion.bash; COMP_WORDS=({}); "
        "COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); _plenocal; echo \"${{COMPREPLY[@]}}\"' >reply",
        Path("").string(),
        words);
    EXPECT_EQ(std::system(command.c_str()), 0);
    return Read("reply");
  };
  EXPECT_EQ(completed("plenocal und"), "undistort\n");
  EXPECT_EQ(completed("plenocal --plugin ./libmine.so und"), "undistort\n");
  EXPECT_EQ(completed("plenocal calibrate session.yaml --thr"), "--threads\n");
  EXPECT_EQ(completed("plenocal undistort --interpolation lin"), "linear\n");
  EXPECT_EQ(completed("plenocal help cali"), "calibrate\n");
  EXPECT_EQ(completed("plenocal models ch"), "check\n");
  EXPECT_EQ(completed("plenocal completion z"), "zsh\n");
  // Files are left to the shell.
  EXPECT_EQ(completed("plenocal calibrate --out -"), "\n");
}

TEST_F(CommandLine, ZshCompletionHasEachCommand) {
  const std::string script = Run({"completion", "zsh"}).out;
  EXPECT_THAT(script, StartsWith("#compdef plenocal\n"));
  for (const char* command : {"calibrate", "undistort", "models"}) {
    EXPECT_THAT(script, HasSubstr(fmt::format("        {})\n          _arguments", command)));
  }
  EXPECT_THAT(script, HasSubstr(":value:(linear nearest"));
}

TEST_F(CommandLine, ManPagesHaveTheTextOfTheHelp) {
  ASSERT_EQ(Run({"help", "--man", "man1"}).status, kDone);
  EXPECT_THAT(Read("man1/plenocal.1"),
              AllOf(StartsWith(".TH plenocal 1"),
                    HasSubstr("\n.TP\n\\fBcalibrate\\fR\n"),
                    HasSubstr("PLENOCAL_PLUGINS"),
                    HasSubstr("\n.TP\n3\n")));  // each exit status of docs/guide.md
  EXPECT_THAT(Read("man1/plenocal-rectify.1"),
              AllOf(HasSubstr("plenocal\\-rectify \\- "),
                    HasSubstr("\\-\\-out"),
                    HasSubstr("write <camera>/map_x.tiff and map_y.tiff")));
  EXPECT_THAT(Read("man1/plenocal-models.1"), HasSubstr(".SS plenocal models check\n"));
  EXPECT_THAT(Run({"help", "--help"}).out, Not(HasSubstr("--man")));
  // Lines as they are, indented: as many begin as end, and none is within another.
  for (const auto& entry : std::filesystem::directory_iterator(Path("man1"))) {
    std::istringstream lines(Read("man1/" + entry.path().filename().string()));
    bool as_it_is = false;
    for (std::string line; std::getline(lines, line);) {
      if (line != ".nf" && line != ".fi") continue;
      EXPECT_EQ(as_it_is, line == ".fi") << entry.path();
      as_it_is = line == ".nf";
    }
    EXPECT_FALSE(as_it_is) << entry.path();
  }
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

TEST_F(CommandLine, QuietPrintsNothingWhereResultsAreFiles) {
  WriteProblem(EasyProblem());
  const Outcome quiet = Run({"calibrate", "session.yaml", "-o", "out", "--quiet"});
  EXPECT_EQ(quiet.status, kDone);
  EXPECT_EQ(quiet.err, "");
  EXPECT_EQ(quiet.out, "");
  EXPECT_THAT(Results("out"), Contains("calibration.yaml"));
  for (const std::vector<std::string>& arguments :
       {std::vector<std::string>{"report", "out"},
        {"detect", "session.yaml", "-o", "detected"},
        {"map", "out/calibration.yaml", "-o", "map"},
        {"convert", "out/calibration.yaml", "--to", "pinhole", "-o", "converted"},
        {"export", "out/calibration.yaml", "--format", "opencv", "-o", "opencv.yaml"}}) {
    std::vector<std::string> all = arguments;
    all.emplace_back("--quiet");
    const Outcome outcome = Run(all);
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    EXPECT_EQ(outcome.out + outcome.err, "") << arguments[0];
  }
}

TEST_F(CommandLine, QuietDoesNotSilenceWhatIsAskedFor) {
  WriteProblem(EasyProblem());
  Calibrate();
  const Outcome same = Run({"compare", "out/calibration.yaml", "out/calibration.yaml", "--quiet"});
  EXPECT_THAT(same.out, HasSubstr("same within uncertainty"));
  EXPECT_EQ(Run({"calibrate", "nowhere.yaml", "-o", "out", "--quiet"}).err.substr(0, 10),
            "plenocal: ");
}

// Standard output of `plenocal calibrate` on a terminal.
class Terminal : public Workspace {
 protected:
  [[nodiscard]] std::string Shown(const std::map<std::string, std::string>& environment) const {
    int terminal = -1;
    const pid_t child = forkpty(&terminal, nullptr, nullptr, nullptr);
    if (child == 0) {
      if (chdir(Path("").c_str()) != 0) _exit(126);
      unsetenv("NO_COLOR");
      for (const auto& [name, value] : environment) setenv(name.c_str(), value.c_str(), 1);
      execl(PLENOCAL_PROGRAM,
            "plenocal",
            "calibrate",
            "session.yaml",
            "-o",
            "out",
            "--no-report",
            static_cast<char*>(nullptr));
      _exit(127);
    }
    std::string shown;
    char buffer[4096];
    // Reading fails when the program has closed the terminal.
    for (ssize_t count = 0; (count = read(terminal, buffer, sizeof buffer)) > 0;) {
      shown.append(buffer, static_cast<std::size_t>(count));
    }
    close(terminal);
    int status = 0;
    waitpid(child, &status, 0);
    EXPECT_EQ(status, 0) << shown;
    return shown;
  }
};

TEST_F(Terminal, HasColoursUnlessTheUserForbidsThem) {
  WriteProblem(EasyProblem());
  const std::string heading = "cam0  (pinhole-radial3, 1280 x 960 px)";
  EXPECT_THAT(Shown({{"TERM", "xterm"}}), HasSubstr("\033[1m" + heading + "\033[0m"));
  for (const auto& environment :
       {std::map<std::string, std::string>{{"TERM", "xterm"}, {"NO_COLOR", "1"}},
        std::map<std::string, std::string>{{"TERM", "dumb"}}}) {
    const std::string plain = Shown(environment);
    EXPECT_THAT(plain, HasSubstr("\n" + heading));
    EXPECT_THAT(plain, Not(HasSubstr("\033[1m")));
  }
}

TEST_F(CommandLine, MessagesWithoutATerminalHoldNoControlCharacters) {
  WriteProblem(EasyProblem());
  const Outcome outcome = Calibrate();
  EXPECT_THAT(outcome.err, HasSubstr("cam0: 10 frames"));
  EXPECT_EQ(outcome.err.find_first_of("\r\033"), std::string::npos);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
