// SPDX-License-Identifier: Apache-2.0
//
// Outputs that are no regular files: links, pipes, devices, nothing. Each command that writes a
// file is given them.
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include "tests/apps/files/small_inputs.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

// A command whose last argument is the file that it writes, and the ending of its name.
struct Writer {
  std::string name;
  std::vector<std::string> arguments;
  std::string ending;
};

class Outputs : public SmallInputs, public ::testing::WithParamInterface<Writer> {
 protected:
  Outputs() {
    Write("poses.txt", "0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n2 1 1 0 0 0 0 1\n3 1 1 2 0 0 0 1\n");
    const std::string given = "given/calibration.yaml";
    EXPECT_EQ(Run({"export", given, "--format", "kalibr", "-o", "chain.yaml"}).status, kDone);
  }

  [[nodiscard]] Outcome RunInto(const std::string& file, const RunOptions& options = {}) const {
    std::vector<std::string> arguments = GetParam().arguments;
    arguments.push_back(file);
    return Run(arguments, options);
  }
  [[nodiscard]] std::string Named(const std::string& stem) const {
    return stem + GetParam().ending;
  }
  // What the command writes into an ordinary file.
  [[nodiscard]] std::string Expected() const {
    const Outcome outcome = RunInto(Named("plain"));
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    return Read(Named("plain"));
  }
};

TEST_P(Outputs, ThatLinksLeadToAreWrittenAndTheLinksStay) {
  const std::string expected = Expected();
  fs::create_directory(Path("elsewhere"));
  const std::string first = Named("first"), second = Named("second"), end = Named("elsewhere/end");
  fs::create_symlink(second, Path(first));
  fs::create_symlink(Path(end), Path(second));
  for (const char* before : {"nothing", "earlier"}) {
    if (before == std::string("earlier")) Write(end, before);
    const Outcome outcome = RunInto(first);
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    EXPECT_TRUE(fs::is_symlink(Path(first)) && fs::is_symlink(Path(second))) << before;
    EXPECT_EQ(Read(end), expected) << before;
  }
}

TEST_P(Outputs, ThatArePipesAreWrittenAndStay) {
  const std::string expected = Expected(), pipe = Named("pipe");
  ASSERT_EQ(mkfifo(Path(pipe).c_str(), 0600), 0);
  const int reader = open(Path(pipe).c_str(), O_RDONLY | O_NONBLOCK);
  std::string content;
  const auto take = [&] {
    char buffer[1 << 16];
    for (ssize_t count = 0; (count = read(reader, buffer, sizeof buffer)) > 0;) {
      content.append(buffer, static_cast<size_t>(count));
    }
    return false;
  };
  const Outcome outcome = RunInto(pipe, {.interrupt_when = take});
  take();
  close(reader);
  EXPECT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_EQ(content, expected);
  EXPECT_TRUE(fs::is_fifo(Path(pipe)));
}

TEST_P(Outputs, ThatAreFullDevicesEndInAMessage) {
  const std::string full = Named("full");
  constexpr int kMemory = 1, kFull = 7;  // of Linux's devices
  if (mknod(Path(full).c_str(), S_IFCHR | 0600, makedev(kMemory, kFull)) != 0) {
    GTEST_SKIP() << "only root makes devices";
  }
  const Outcome outcome = RunInto(full);
  EXPECT_EQ(outcome.status, kJobFailed) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr(full + ": cannot be written: No space left on device"));
  EXPECT_TRUE(fs::is_character_file(Path(full)));
}

TEST_P(Outputs, BeyondALimitForTheSizeOfFilesEndInAMessage) {
  const std::string expected = Expected(), file = Named("plain");
  const Outcome outcome = RunInto(file, {.file_size_limit = expected.size() - 1});
  EXPECT_EQ(outcome.status, kJobFailed) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr(file + ": cannot be written: File too large"));
  EXPECT_EQ(Read(file), expected);
}

TEST_P(Outputs, ThatAreFoldersOrNothingAreRefused) {
  const auto before = Files("");
  const std::string folder = Named("folder"), loop = Named("loop");
  fs::create_directory(Path(folder));
  fs::create_symlink(loop, Path(loop));
  for (const auto& [file, message] : std::map<std::string, std::string>{
           {"", ": is empty"}, {folder, "is a folder"}, {loop, "leads to itself"}}) {
    const Outcome outcome = RunInto(file);
    EXPECT_EQ(outcome.status, kWrongInput) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(message)) << file;
  }
  fs::remove(Path(loop));
  EXPECT_EQ(Files(""), before);
}

INSTANTIATE_TEST_SUITE_P(
    Each,
    Outputs,
    ::testing::Values(
        Writer{"export", {"export", "given/calibration.yaml", "--format", "kalibr", "-o"}, ""},
        Writer{"import", {"import", "chain.yaml", "--format", "kalibr", "-o"}, ".yaml"},
        Writer{"map", {"map", "given/calibration.yaml", "--size", "64x48", "-o"}, ".yml"},
        Writer{"target", {"target", "target.yaml", "-o"}, ".svg"},
        Writer{"handeye", {"handeye", "given", "--poses", "given/poses.csv", "-o"}, ""},
        Writer{"locate", {"locate", "given/calibration.yaml", "target.yaml", "cam0.csv", "-o"}, ""},
        Writer{"suggest", {"suggest", "given", "--count", "1", "--picture"}, ".svg"},
        Writer{"evaluate",
               {"evaluate", "--estimate", "poses.txt", "--truth", "poses.txt", "--chart"},
               ".svg"}),
    [](const auto& writer) { return writer.param.name; });

class OutputFolders : public SmallInputs {};

TEST_F(OutputFolders, HaveNoLinkOrPipeReplaced) {
  fs::create_directory(Path("out"));
  fs::create_symlink("../session.yaml", Path("out/report.html"));
  const std::string session = Read("session.yaml");
  const Outcome link = Run({"calibrate", "session.yaml", "-o", "out"});
  EXPECT_EQ(link.status, kJobFailed);
  EXPECT_THAT(link.err,
              HasSubstr("out/report.html: is a symbolic link where a result file belongs"));
  EXPECT_EQ(Read("session.yaml"), session);
  fs::remove(Path("out/report.html"));
  ASSERT_EQ(mkfifo(Path("out/poses.csv").c_str(), 0600), 0);
  const Outcome pipe = Run({"calibrate", "session.yaml", "-o", "out"});
  EXPECT_EQ(pipe.status, kJobFailed);
  EXPECT_THAT(pipe.err, HasSubstr("out/poses.csv: is a device, pipe"));
  EXPECT_TRUE(fs::is_fifo(Path("out/poses.csv")));
}

TEST_F(OutputFolders, AreNotNamedByAnEmptyText) {
  const auto before = Files("");
  for (const char* command : {"calibrate", "detect", "try"}) {
    const Outcome outcome = Run({command, "session.yaml", "-o", ""});
    EXPECT_EQ(outcome.status, kWrongInput) << command;
    EXPECT_THAT(outcome.err, HasSubstr("--out: is empty")) << command;
    EXPECT_EQ(Files(""), before);
  }
  const Outcome cache = Run({"calibrate", "session.yaml", "-o", "out", "--cache", ""});
  EXPECT_EQ(cache.status, kWrongInput);
  EXPECT_THAT(cache.err, HasSubstr("--cache: is empty"));
}

TEST_F(OutputFolders, AreNotMadeBesideAnOpenFile) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const std::string file = fmt::format("/dev/fd/{}", ends[1]);
  const std::vector<std::string> arguments{
      "export", "given/calibration.yaml", "--format", "kalibr", "--quiet", "-o", file};
  EXPECT_EQ(Run(arguments).status, kDone);
  char start[8] = {};
  EXPECT_EQ(read(ends[0], start, sizeof start), 8);
  EXPECT_EQ(std::string(start, 4), "cam0");
  // Nobody reads any more.
  close(ends[0]);
  const Outcome outcome = Run(arguments);
  close(ends[1]);
  EXPECT_EQ(outcome.status, kJobFailed);
  EXPECT_THAT(outcome.err, HasSubstr(file + ": cannot be written: Broken pipe"));
}

// As /dev/stdout, which a program without this would replace.
TEST_F(OutputFolders, AreNotMadeAroundStandardOutput) {
  fs::create_symlink("/proc/self/fd/1", Path("stdout"));
  const Outcome outcome =
      Run({"export", "given/calibration.yaml", "--format", "kalibr", "--quiet", "-o", "stdout"});
  EXPECT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out, ::testing::StartsWith("cam0:"));
  EXPECT_TRUE(fs::is_symlink(Path("stdout")));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
