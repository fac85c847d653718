// SPDX-License-Identifier: Apache-2.0
//
// Results are complete or not there, whatever the disk does.
#include <unistd.h>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

class Commit : public Workspace {
 protected:
  Commit() { WriteProblem(EasyProblem()); }
};

TEST_F(Commit, OfAReportThatDoesNotFitFailsAsAWhole) {
  Calibrate();
  const auto before = Files("out");
  size_t largest = 0;
  for (const auto& [name, text] : before) {
    if (name != "report.html") largest = std::max(largest, text.size());
  }
  const size_t limit = largest + 1000;
  ASSERT_GT(before.at("report.html").size(), limit);
  Write("session.yaml", Replaced(Read("session.yaml"), "huber", "cauchy"));
  const Outcome outcome =
      Run({"calibrate", "session.yaml", "-o", "out", "--quiet"}, {.file_size_limit = limit});
  EXPECT_EQ(outcome.status, kJobFailed);
  EXPECT_THAT(outcome.err, HasSubstr("report.html: cannot be written"));
  EXPECT_EQ(Files("out"), before);
}

TEST_F(Commit, ThatWasStoppedHalfWayIsCompletedByTheNextReader) {
  const std::string session = Read("session.yaml");
  Calibrate("old");
  Write("session.yaml", Replaced(session, "huber", "cauchy"));
  Calibrate("new");
  Write("later.yaml", session + "from: out/calibration.yaml\n");
  for (const std::vector<std::string>& reader : std::vector<std::vector<std::string>>{
           {"convert", "out/calibration.yaml", "--to", "pinhole-radtan", "-o", "x"},
           {"calibrate", "later.yaml", "-o", "later"}}) {
    fs::remove_all(Path("out"));
    fs::copy(Path("old"), Path("out"), fs::copy_options::recursive);
    fs::copy(Path("new"), Path("out/.partial"), fs::copy_options::recursive);
    fs::rename(Path("out/.partial/poses.csv"), Path("out/poses.csv"));
    Write("out/.partial/complete", "");
    EXPECT_EQ(Run(reader).status, kDone);
    for (const auto& [name, text] : Files("new")) EXPECT_EQ(Read("out/" + name), text) << name;
    EXPECT_FALSE(fs::exists(Path("out/.partial")));
  }
}

TEST_F(Commit, GivesTheSamePdfAtAnotherTime) {
  EXPECT_EQ(Run({"target", "target.yaml", "-o", "a.pdf"}).status, kDone);
  sleep(1);  // a date in it would count seconds
  EXPECT_EQ(Run({"target", "target.yaml", "-o", "b.pdf"}).status, kDone);
  EXPECT_EQ(Read("a.pdf"), Read("b.pdf"));
}

// A locale that is not installed changes nothing; where it is, its decimal comma must not either.
TEST_F(Commit, GivesTheSameBytesInAnyLocaleTimeZoneAndNumberOfThreads) {
  Calibrate();
  const auto expected = Files("out");
  for (const auto& [variable, value] : std::map<std::string, std::string>{
           {"LC_ALL", "de_DE.UTF-8"}, {"LC_NUMERIC", "fr_FR.UTF-8"}, {"TZ", "Asia/Tokyo"}}) {
    fs::remove_all(Path("out"));
    EXPECT_EQ(Run({"calibrate", "session.yaml", "-o", "out"}, {.environment = {{variable, value}}})
                  .status,
              kDone);
    EXPECT_EQ(Files("out"), expected) << variable;
  }
  for (const char* threads : {"1", "2", "3", "7"}) {
    fs::remove_all(Path("out"));
    EXPECT_EQ(Run({"calibrate", "session.yaml", "-o", "out", "--threads", threads}).status, kDone);
    EXPECT_EQ(Files("out"), expected) << threads;
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
