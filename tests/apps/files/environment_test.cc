// SPDX-License-Identifier: Apache-2.0
//
// What surrounds a run: folders that cannot be written, limits of the system, an empty environment,
// a decimal comma, wrong clocks. Either the results are the same, or a message says why not.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>

#include "tests/apps/files/small_inputs.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

struct NamedCommand {
  std::string name;
  std::vector<std::string> arguments;
  std::string largest;  // of its results
};

class Surroundings : public SmallInputs, public ::testing::WithParamInterface<NamedCommand> {
 protected:
  [[nodiscard]] Outcome RunIt(const RunOptions& options = {}) const {
    std::vector<std::string> arguments = GetParam().arguments;
    arguments.insert(arguments.end(), {"-o", "out"});
    return Run(arguments, options);
  }

  void ExpectTheSame(const RunOptions& options) const {
    ASSERT_EQ(RunIt().status, kDone);
    const auto expected = Files("out");
    ASSERT_FALSE(expected.empty());
    fs::remove_all(Path("out"));
    const Outcome outcome = RunIt(options);
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    EXPECT_EQ(Files("out"), expected);
  }

  // One message on the last line of standard error, status 1, and `out` as it was.
  void ExpectRefusal(const RunOptions& options, const std::string& message) const {
    const auto before = Files("out");
    const Outcome outcome = RunIt(options);
    EXPECT_EQ(outcome.status, kJobFailed) << outcome.err;
    EXPECT_EQ(Files("out"), before);
    const std::vector<std::string> lines = Lines(outcome.err);
    const auto is_error = [](const auto& line) { return line.starts_with("plenocal: "); };
    ASSERT_EQ(std::count_if(lines.begin(), lines.end(), is_error), 1) << outcome.err;
    EXPECT_TRUE(is_error(lines.back())) << outcome.err;
    EXPECT_THAT(lines.back(), HasSubstr(message));
  }
};

TEST_P(Surroundings, OfAFolderThatCannotBeWrittenAreRefused) {
  fs::create_directory(Path("out"));
  Write("out/old", "old");
  fs::permissions(Path("out"), fs::perms::owner_read | fs::perms::owner_exec);
  ExpectRefusal({}, "cannot write into this output folder: Permission denied");
  fs::permissions(Path("out"), fs::perms::owner_all);
}

TEST_P(Surroundings, OfALimitForTheSizeOfFilesAreRefused) {
  ASSERT_EQ(RunIt().status, kDone);
  const size_t limit = Read("out/" + GetParam().largest).size() / 2;
  fs::remove_all(Path("out"));
  Write("out/old", "old");
  ExpectRefusal({.file_size_limit = limit}, "cannot be written: File too large");
}

TEST_P(Surroundings, OfFewOpenFilesGiveTheSame) { ExpectTheSame({.open_files_limit = 20}); }

TEST_P(Surroundings, OfTooFewOpenFilesAreRefused) {
  const Outcome outcome = RunIt({.open_files_limit = 5});
  if (outcome.status == kDone) return;
  EXPECT_THAT(outcome.status, ::testing::AnyOf(kJobFailed, kWrongInput, 127)) << outcome.err;
  EXPECT_FALSE(outcome.err.empty());
  EXPECT_TRUE(Files("out").empty());
}

TEST_P(Surroundings, OfNoVariablesGiveTheSame) { ExpectTheSame({.no_environment = true}); }

TEST_P(Surroundings, OfADecimalCommaGiveTheSame) {
  Write("comma",
        "comment_char %\nescape_char /\nLC_NUMERIC\ndecimal_point \",\"\n"
        "thousands_sep \".\"\ngrouping 3\nEND LC_NUMERIC\n");
  const std::string make = fmt::format(
      "localedef -c -i {} {} >/dev/null 2>&1", Path("comma").string(), Path("xx_XX").string());
  [[maybe_unused]] const int warned = std::system(make.c_str());
  if (!fs::exists(Path("xx_XX/LC_NUMERIC"))) GTEST_SKIP() << "localedef is not installed";
  ExpectTheSame({.environment = {{"LOCPATH", Path("").string()}, {"LC_ALL", "xx_XX"}}});
}

TEST_P(Surroundings, OfAClockThatJumpsGiveTheSame) {
  ExpectTheSame({.environment = {{"LD_PRELOAD", PLENOCAL_JUMPING_CLOCK},
                                 {"ASAN_OPTIONS", "verify_asan_link_order=0"}}});
}

TEST_P(Surroundings, OfFilesFromTheFutureAndFromLongAgoGiveTheSame) {
  ASSERT_EQ(RunIt().status, kDone);
  const auto expected = Files("out");
  for (const int years : {-100, 30}) {
    for (const auto& entry : fs::recursive_directory_iterator(Path(""))) {
      fs::last_write_time(entry, fs::file_time_type::clock::now() + std::chrono::years(years));
    }
    const Outcome outcome = RunIt();  // with the cache, which is as old
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    EXPECT_EQ(Files("out"), expected) << years;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Each,
    Surroundings,
    ::testing::Values(
        NamedCommand{"calibrate", {"calibrate", "session.yaml"}, "report.html"},
        NamedCommand{"try", {"try", "session.yaml", "--models", "pinhole"}, "try.html"},
        NamedCommand{"detect", {"detect", "session.yaml"}, "detections_cam0.csv"},
        NamedCommand{"simulate", {"simulate", "spec.yaml"}, "truth/detections_cam.csv"},
        NamedCommand{
            "undistort", {"undistort", "given/calibration.yaml", "image.pgm"}, "image.png"}),
    [](const auto& command) { return command.param.name; });

}  // namespace TEST_FILE
}  // namespace plenocal::testing
