// SPDX-License-Identifier: Apache-2.0
//
// Standard streams that are closed or full, signals, and what foreign libraries print.
#include <fmt/format.h>
#include <zlib.h>

#include <chrono>
#include <csignal>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

class Streams : public Workspace {
 protected:
  Streams() { WriteProblem(EasyProblem()); }
};

TEST_F(Streams, OfMessagesMayBeFullOrClosed) {
  EXPECT_EQ(Run({"nonsense"}, {.stderr_path = "/dev/full"}).status, kWrongInput);
  EXPECT_EQ(Run({"nonsense"}, {.close_streams = true}).status, kWrongInput);
  EXPECT_EQ(Run({"calibrate", "session.yaml", "-o", "out"}, {.stderr_path = "/dev/full"}).status,
            kDone);
}

TEST_F(Streams, OfResultsThatAreFullEndAnyCommandInAMessage) {
  Calibrate();
  std::vector<std::vector<std::string>> all{
      {"--help"},
      {"--version"},
      {"report", "out"},
      {"calibrate", "session.yaml", "-o", "again"},
      {"suggest", "out", "--json"},
      {"export", "out/calibration.yaml", "--format", "ros", "-o", "ros.yaml"},
      {"compare", "out/calibration.yaml", "out/calibration.yaml"}};
  for (const std::string& line : Lines(Run({"--help"}).out)) {
    if (line.starts_with("  workbench ")) all.push_back({"workbench", "--no-open"});
    // Two blanks, a command and what it is for.
    if (line.size() < 3 || !line.starts_with("  ") || std::islower(line[2]) == 0) continue;
    const std::string command = line.substr(2, line.find(' ', 2) - 2);
    if (command != "plenocal") all.push_back({command, "--help"});
  }
  EXPECT_GT(all.size(), 35U);
  for (const std::vector<std::string>& arguments : all) {
    const Outcome outcome = Run(arguments, {.stdout_path = "/dev/full"});
    EXPECT_EQ(outcome.status, kJobFailed) << arguments[0];
    EXPECT_THAT(outcome.err, HasSubstr("standard output: ")) << arguments[0];
    EXPECT_THAT(outcome.err, HasSubstr("No space left on device")) << arguments[0];
  }
}

TEST_F(Streams, ThatAreClosedAreNotResultFiles) {
  // Without a stream its number is that of the next file.
  const Outcome outcome = Run({"calibrate", "session.yaml", "-o", "out"}, {.close_streams = true});
  EXPECT_EQ(outcome.status, kJobFailed) << "the summary cannot be printed";
  EXPECT_EQ(Run({"report", "out", "--quiet"}).status, kDone);
  for (const auto& [name, text] : Files("out")) {
    EXPECT_THAT(text, Not(HasSubstr("written to out"))) << name;
  }
}

// Each of these takes many seconds.
TEST_F(Streams, OfAnyCommandEndWithinASecondOfASignal) {
  Calibrate();
  WriteProblem(MakeProblem(3, {.frames = 400, .noise = 0.1}));
  const std::vector<std::string> map{
      "map", "out/calibration.yaml", "--size", "16000x16000", "--quiet", "-o", "slow/map.yml"};
  const std::vector<std::string> tries{"try", "session.yaml", "--quiet", "-o", "slow"};
  for (const auto& [arguments, signal] : {std::pair(map, SIGINT), {tries, SIGTERM}}) {
    SCOPED_TRACE(arguments[0]);
    using Clock = std::chrono::steady_clock;
    const Clock::time_point start = Clock::now();
    Clock::time_point sent;
    const Outcome outcome = Run(arguments,
                                {.interrupt_when =
                                     [&] {
                                       sent = Clock::now();
                                       return sent - start > std::chrono::milliseconds(500);
                                     },
                                 .signal = signal});
    // With some room for a machine that has other work.
    EXPECT_LT(Clock::now() - sent, std::chrono::seconds(3));
    EXPECT_EQ(outcome.status, kInterrupted);
    EXPECT_THAT(outcome.err, HasSubstr("interrupted; no result files were written"));
    EXPECT_THAT(Results("slow"), ::testing::IsEmpty());
  }
}

// A log shows what a run of minutes is at.
TEST_F(Streams, ThatAreFilesHaveALineOfProgressNowAndThen) {
  WriteProblem(MakeProblem(3, {.frames = 400, .noise = 0.1}));
  const std::string log = Path("log").string();
  constexpr size_t kLines = 3;  // two of messages, one of progress
  const auto has_line = [&] { return fs::exists(log) && Lines(Read("log")).size() >= kLines; };
  const Outcome outcome = Run({"try", "session.yaml", "-o", "slow", "--threads", "1"},
                              {.stderr_path = log, .interrupt_when = has_line});
  EXPECT_EQ(outcome.status, kInterrupted);
  EXPECT_THAT(Lines(Read("log")).at(kLines - 1), HasSubstr("model "));
  EXPECT_THAT(Read("log"), Not(HasSubstr("\r")));
}

// A PNG of 8 x 8 grey pixels whose compressed data are broken, with checksums that fit.
std::string BrokenPng() {
  const auto bytes = [](std::uint32_t value) {
    std::string text;
    for (const unsigned shift : {24U, 16U, 8U, 0U}) text += static_cast<char>(value >> shift);
    return text;
  };
  const auto chunk = [&](const std::string& type, const std::string& data) {
    const std::string body = type + data;
    const auto crc = crc32_z(0, reinterpret_cast<const unsigned char*>(body.data()), body.size());
    return bytes(static_cast<std::uint32_t>(data.size())) + body +
           bytes(static_cast<std::uint32_t>(crc));
  };
  const std::string header = bytes(8) + bytes(8) + std::string("\x08\x00\x00\x00\x00", 5);
  return "\x89PNG\r\n\x1a\n" + chunk("IHDR", header) + chunk("IDAT", "\x78\x9cnonsense") +
         chunk("IEND", "");
}

TEST_F(Streams, HoldNothingOfForeignLibrariesAndNoControlCharacters) {
  Write("images/bad.png", BrokenPng());
  Write("session.yaml",
        "plenocal: 1\ntarget: target.yaml\ncameras:\n  cam:\n    model: pinhole-radial3\n"
        "    images: images\n");
  for (const char* quiet : {"--quiet", "--fresh"}) {
    const Outcome outcome = Run({"calibrate", "session.yaml", "-o", "out", quiet});
    EXPECT_NE(outcome.status, kDone);
    EXPECT_THAT(outcome.err, Not(HasSubstr("libpng")));
    EXPECT_THAT(outcome.err, HasSubstr("bad.png"));
  }
  const Outcome outcome = Run({"calibrate", "\x1b[31mred.yaml", "-o", "out"});
  EXPECT_THAT(outcome.err, HasSubstr("\\u001b[31mred.yaml"));
  EXPECT_THAT(outcome.err, Not(HasSubstr("\x1b")));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
