// SPDX-License-Identifier: Apache-2.0
//
// Results are written all or none, in their folder alone, and never over an input.
#include "calib/io/output_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <functional>
#include <future>
#include <map>
#include <optional>
#include <sstream>
#include <string>
#include <thread>

#include "calib/base/error.h"
#include "calib/io/detection_cache.h"
#include "calib/io/input_file.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

class Results : public ::testing::Test {
 protected:
  Results() {
    std::string name = (fs::temp_directory_path() / "plenocal_results_XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("cannot make " + name);
    root_ = name;
    out_ = root_ / "out";
    fs::create_directory(out_);
  }
  ~Results() override { fs::remove_all(root_); }

  static void Put(const fs::path& path, const std::string& text) {
    fs::create_directories(path.parent_path());
    std::ofstream(path) << text;
  }
  static std::string Text(const fs::path& path) {
    std::ostringstream text;
    text << std::ifstream(path).rdbuf();
    return text.str();
  }
  // What a run leaves that was killed after it had moved one of two files.
  void LeaveHalfMoved() const {
    Put(out_ / "poses.csv", "new");
    Put(out_ / "calibration.yaml", "old");
    Put(out_ / "report.html", "old");
    Put(out_ / ".partial/calibration.yaml", "new");
    Put(out_ / ".partial/complete", "report.html\n");
  }
  void ExpectNew() const {
    EXPECT_EQ(Text(out_ / "poses.csv"), "new");
    EXPECT_EQ(Text(out_ / "calibration.yaml"), "new");
    EXPECT_FALSE(fs::exists(out_ / "report.html"));
    EXPECT_FALSE(fs::exists(out_ / ".partial"));
  }

  fs::path root_, out_;
};

TEST_F(Results, ThatAKilledRunLeftHalfMovedAreCompletedByAWriter) {
  LeaveHalfMoved();
  { const OutputFolder next(out_); }
  ExpectNew();
}

TEST_F(Results, ThatAKilledRunLeftHalfMovedAreCompletedWhereTheyAreOpened) {
  for (const fs::path& opened :
       {out_, out_ / "", out_ / "calibration.yaml", out_ / "images/left/01.png"}) {
    LeaveHalfMoved();
    CompleteResults(opened);
    EXPECT_EQ(ReadTextFile(out_ / "calibration.yaml"), "new") << opened;
    ExpectNew();
  }
}

TEST_F(Results, ThatAKilledRunLeftHalfMovedAreNotReadAndNotMovedByAReader) {
  LeaveHalfMoved();
  const auto files = [&] {
    std::map<fs::path, std::string> found;
    for (const auto& entry : fs::recursive_directory_iterator(root_)) {
      found[entry.path()] = entry.is_regular_file() ? Text(entry.path()) : "";
    }
    return found;
  };
  const auto before = files();
  for (const char* name : {"calibration.yaml", "poses.csv"}) {
    EXPECT_THAT(testing::RefusalOf([&] { ReadTextFile(out_ / name); }, ErrorKind::kJob),
                AllOf(HasSubstr(out_.string()), HasSubstr("half moved")));
  }
  EXPECT_EQ(files(), before);
}

TEST_F(Results, AreNotReadWhereAnotherRunMovesThem) {
  OutputFolder writer(out_);
  LeaveHalfMoved();
  EXPECT_THAT(testing::RefusalOf([&] { ReadTextFile(out_ / "calibration.yaml"); }, ErrorKind::kJob),
              AllOf(HasSubstr(out_.string()), HasSubstr("half moved"), HasSubstr("another run")));
  EXPECT_THAT(testing::RefusalOf([&] { CompleteResults(out_); }, ErrorKind::kJob),
              AllOf(HasSubstr(out_.string()), HasSubstr("half moved"), HasSubstr("another run")));
}

TEST_F(Results, MayBeCompletedByAnotherProcessMeanwhile) {
  OutputFolder writer(out_);
  LeaveHalfMoved();
  auto completing = std::async(std::launch::async, [&] { CompleteResults(out_); });
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  fs::remove_all(out_ / ".partial");
  EXPECT_NO_THROW(completing.get());
}

TEST_F(Results, OfTwoWritersAtATimeAreRefused) {
  const OutputFolder first(out_);
  EXPECT_THAT(testing::RefusalOf([&] { const OutputFolder second(out_); }, ErrorKind::kJob),
              AllOf(HasSubstr(out_.string()), HasSubstr("another run of plenocal writes")));
}

TEST_F(Results, ThatCannotAllBeMovedAreNotMoved) {
  OutputFolder out(out_);
  out.Write("a/1.txt", "new");
  out.Write("z/2.txt", "new");
  Put(out_ / "z/2.txt/in the way", "");
  EXPECT_THAT(testing::RefusalOf([&] { out.Commit(); }, ErrorKind::kJob),
              HasSubstr("z/2.txt: is a folder"));
  EXPECT_FALSE(fs::exists(out_ / "a/1.txt"));
}

TEST_F(Results, StayHalfMovedWhereAMoveFailsUntilItIsMended) {
  LeaveHalfMoved();
  fs::remove(out_ / "calibration.yaml");
  Put(out_ / "calibration.yaml/in the way", "");
  EXPECT_THAT(testing::RefusalOf([&] { const OutputFolder next(out_); }, ErrorKind::kJob),
              AllOf(HasSubstr(out_.string()), HasSubstr("mend this")));
  EXPECT_EQ(Text(out_ / ".partial/calibration.yaml"), "new");
  fs::remove_all(out_ / "calibration.yaml");
  { const OutputFolder next(out_); }
  ExpectNew();
}

TEST_F(Results, AreRemovedNowhereElse) {
  Put(root_ / "victim", "precious");
  for (const std::string& name :
       {std::string("../victim"), (root_ / "victim").string(), std::string("a/../../victim")}) {
    Put(out_ / ".partial/complete", name + "\n");
    EXPECT_THAT(testing::RefusalOf([&] { const OutputFolder next(out_); }, ErrorKind::kJob),
                HasSubstr("victim"));
    EXPECT_EQ(Text(root_ / "victim"), "precious");
  }
}

TEST_F(Results, AreWrittenNowhereElse) {
  fs::create_directory(root_ / "elsewhere");
  fs::create_directory_symlink(root_ / "elsewhere", out_ / "link");
  OutputFolder out(out_);
  for (const std::string& name : {std::string("../evil"),
                                  (root_ / "evil").string(),
                                  std::string("a/../../evil"),
                                  std::string("link/evil"),
                                  std::string("")}) {
    EXPECT_NE(testing::RefusalOf([&] { out.Write(name, "x"); }, ErrorKind::kJob), "no refusal")
        << name;
  }
  out.Commit();
  EXPECT_FALSE(fs::exists(root_ / "evil"));
  EXPECT_TRUE(fs::is_empty(root_ / "elsewhere"));
}

TEST_F(Results, OfAFolderInPlaceOfAFileAreRefused) {
  OutputFolder out(out_);
  out.Write("images", "x");
  EXPECT_THAT(testing::RefusalOf([&] { out.Write("images/a.png", "x"); }, ErrorKind::kJob),
              AllOf(HasSubstr("images: this folder cannot be made: "), HasSubstr("irectory")));
}

TEST_F(Results, NeverReplaceAnInput) {
  const RunScope run;
  Put(out_ / "calibration.yaml", "input");
  fs::create_symlink(out_ / "calibration.yaml", root_ / "link.yaml");
  ReadTextFile(root_ / "link.yaml");
  OutputFolder out(out_);
  EXPECT_THAT(testing::RefusalOf([&] { out.Write("calibration.yaml", "x"); }, ErrorKind::kInput),
              AllOf(HasSubstr("link.yaml"), HasSubstr("would replace this input")));
  out.Write("poses.csv", "x");
  // Read in between.
  Put(out_ / "poses.csv", "input");
  ReadTextFile(out_ / "poses.csv");
  EXPECT_THAT(testing::RefusalOf([&] { out.Commit(); }, ErrorKind::kInput), HasSubstr("poses.csv"));
  EXPECT_EQ(Text(out_ / "poses.csv"), "input");
}

// A program has read it before it began this run.
TEST_F(Results, NeverReplaceAFileThatWasMadeAnInput) {
  Put(out_ / "calibration.yaml", "input");
  UseAsInput(out_ / "calibration.yaml");  // of no run
  EXPECT_FALSE(InputAt(out_ / "calibration.yaml"));
  const RunScope run;
  UseAsInput(out_ / "nothing.yaml");
  OutputFolder out(out_);
  out.Write("nothing.yaml", "x");
  UseAsInput(out_ / "calibration.yaml");
  EXPECT_EQ(InputAt(out_ / "calibration.yaml"), out_ / "calibration.yaml");
  EXPECT_THAT(testing::RefusalOf([&] { out.Write("calibration.yaml", "x"); }),
              HasSubstr("would replace this input"));
}

TEST_F(Results, ReplaceEarlierResultsAndFilesThatCameAfterAnInput) {
  Put(out_ / "a", "earlier");
  ReadEarlierResult(out_ / "a");
  // The new file may have the number of the input that was removed.
  Put(root_ / "input", "x");
  ReadTextFile(root_ / "input");
  fs::remove(root_ / "input");
  Put(out_ / "b", "earlier");
  OutputFolder out(out_);
  out.Write("a", "new");
  out.Write("b", "new");
  out.Commit();
  EXPECT_EQ(Text(out_ / "a") + Text(out_ / "b"), "newnew");
}

TEST_F(Results, OfTheCacheAreAllThatItRemoves) {
  const std::string key = DetectionCache({}, "program", false).Key({"part"});
  Put(root_ / "photos/holiday.jpg", "precious");
  Put(root_ / "photos" / key, "looks like an entry");
  fs::create_directory_symlink(root_ / "photos", out_ / ".cache");
  DetectionCache(out_ / ".cache", "program", false).RemoveUnused();
  EXPECT_TRUE(fs::exists(root_ / "photos" / key));
  fs::remove(out_ / ".cache");
  Put(out_ / ".cache/notes.txt", "precious");
  Put(out_ / ".cache" / key, "old");
  Put(out_ / ".cache" / (key + ".123.4"), "left by a killed run");
  DetectionCache(out_ / ".cache", "program", false).RemoveUnused();
  EXPECT_TRUE(fs::exists(out_ / ".cache/notes.txt"));
  EXPECT_FALSE(fs::exists(out_ / ".cache" / key));
  EXPECT_FALSE(fs::exists(out_ / ".cache" / (key + ".123.4")));
}

}  // namespace TEST_FILE
}  // namespace plenocal
