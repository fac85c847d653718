// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/project/project.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <chrono>
#include <csignal>
#include <random>
#include <thread>

#include "apps/workbench/project/beneath.h"
#include "apps/workbench/project/command_text.h"
#include "apps/workbench/project/session_text.h"
#include "apps/workbench/worker/worker_process.h"
#include "calib/base/error.h"
#include "tests/temporary_folder.h"

namespace plenocal::workbench {
namespace TEST_FILE {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class Folder : public testing::InTemporaryFolder {
 protected:
  [[nodiscard]] std::string Read(const std::string& name) const { return files_.Read(name); }
  [[nodiscard]] std::string ReadSafely(const fs::path& file) const {
    const auto content = ReadBeneath(folder_ / "data", file, 1000);
    return {content.begin(), content.end()};
  }
};

using BeneathRoot = Folder;

TEST_F(BeneathRoot, FilesAreRead) {
  Write("data/left/a.png", "picture");
  EXPECT_EQ(ReadSafely(folder_ / "data/left/a.png"), "picture");
  EXPECT_EQ(ReadSafely(folder_ / "data/x/../left/a.png"), "picture");
}

TEST_F(BeneathRoot, NothingElseIs) {
  Write("data/a", "a");
  Write("secret", "secret");
  Write("data-x/b", "b");
  Write("data/long", std::string(2000, 'a'));
  fs::create_symlink(folder_ / "secret", folder_ / "data/link");
  fs::create_directory_symlink(folder_ / "data-x", folder_ / "data/folder");
  fs::create_symlink("a", folder_ / "data/inside");
  ASSERT_EQ(mkfifo((folder_ / "data/pipe").c_str(), 0600), 0);
  for (const char* name : {"secret",
                           "data/../secret",
                           "data-x/b",
                           "data/link",
                           "data/folder/b",
                           "data/pipe",
                           "data/long",
                           "data/none",
                           "data",
                           "data/"}) {
    EXPECT_THROW((void)ReadSafely(folder_ / name), Error) << name;
  }
  EXPECT_THROW((void)ReadSafely("/proc/self/environ"), Error);
  EXPECT_THROW((void)ReadSafely("/etc/passwd"), Error);
  EXPECT_EQ(ReadSafely(folder_ / "data/inside"), "a");
}

TEST_F(BeneathRoot, FilesAreAddedAndNeverReplaced) {
  const fs::path root = folder_ / "data";
  fs::create_directories(root);
  fs::create_directories(folder_ / "outside");
  fs::create_directory_symlink(folder_ / "outside", root / "link");
  fs::create_symlink(folder_ / "outside/a.png", root / "b.png");
  AddBeneath(root, "left", "a.png", std::string(100'000, 'a'));
  AddBeneath(root, "", "a.png", "of the root");
  EXPECT_EQ(Read("data/left/a.png"), std::string(100'000, 'a'));
  EXPECT_EQ(Read("data/a.png"), "of the root");
  EXPECT_THROW(AddBeneath(root, "left", "a.png", "other"), Error);
  EXPECT_THROW(AddBeneath(root, "", "b.png", "through a link"), Error);
  EXPECT_THROW(AddBeneath(root, "link", "a.png", "through a link"), Error);
  EXPECT_THROW(AddBeneath(root, "..", "a.png", "above"), Error);
  EXPECT_EQ(Read("data/left/a.png"), std::string(100'000, 'a'));
  EXPECT_TRUE(fs::is_empty(folder_ / "outside"));
  EXPECT_EQ(std::distance(fs::directory_iterator(root / "left"), {}), 1) << "nothing half written";
}

TEST(SessionText, GetsAnotherModelAndNothingElse) {
  const std::string text =
      "cameras:  # model: none\n  left: {model: pinhole-radtan, images: a/*}  # mine\n"
      "  right:\n    images: b/*\n    model: \"pinhole-radtan\"\n";
  EXPECT_EQ(WithValue(text, {"cameras", "left", "model"}, "fov"),
            "cameras:  # model: none\n  left: {model: fov, images: a/*}  # mine\n"
            "  right:\n    images: b/*\n    model: \"pinhole-radtan\"\n");
  EXPECT_EQ(WithValue(text, {"cameras", "right", "model"}, "fov"),
            "cameras:  # model: none\n  left: {model: pinhole-radtan, images: a/*}  # mine\n"
            "  right:\n    images: b/*\n    model: fov\n");
  for (const char* other : {"cameras: {a: {model: x}, b: {model: x}}\n",
                            "cameras:\n  a:\n    model:\n      x\n",
                            "cameras: {a: {images: b}}\n",
                            "cameras:\n  a: {images: {model: x}}\n"}) {
    EXPECT_THROW(WithValue(other, {"cameras", "a", "model"}, "fov"), Error) << other;
  }
}

constexpr const char* kText = "plenocal: 1  # mine\ncameras: {}  # to come";

TEST(SessionText, GetsARuleAndNothingElse) {
  const ExcludeRule first{.camera = "left", .frame = "0012", .note = "blurred: badly"},
      second{.frame = "<img>", .markers = {17, 18}};
  const std::string once = WithRule(kText, first);
  EXPECT_EQ(once,
            std::string(kText) +
                "\nexclude:\n  - {camera: left, frame: \"0012\", note: \"blurred: badly\"}\n");
  const std::string twice = WithRule(once + "options: {}\n", second);
  EXPECT_EQ(twice, once + "  - {frame: \"<img>\", markers: [17, 18]}\noptions: {}\n");
  EXPECT_EQ(WithoutRule(twice, second), once + "options: {}\n");
  EXPECT_EQ(WithoutRule(once, first), std::string(kText) + "\n");
}

TEST(SessionText, FindsKeysInQuotes) {
  EXPECT_EQ(WithRule("'exclude':\n  - {frame: a}\n", {.frame = "b"}),
            "'exclude':\n  - {frame: a}\n  - {frame: b}\n");
  EXPECT_EQ(
      WithValue("\"cameras\":\n  left:\n    model: pinhole\n", {"cameras", "left", "model"}, "fov"),
      "\"cameras\":\n  left:\n    model: fov\n");
}

TEST(SessionText, KeepsRulesByHand) {
  const std::string by_hand = "exclude:\n- frame: '1'\n  note: mine\n# a comment\n";
  EXPECT_EQ(WithRule(by_hand, {.frame = "a"}),
            "exclude:\n- frame: '1'\n  note: mine\n- {frame: a}\n# a comment\n");
  // The next dash is another list's.
  EXPECT_EQ(WithRule("exclude:\nmore:\n      - a\n", {.frame = "b"}),
            "exclude:\n  - {frame: b}\nmore:\n      - a\n");
  EXPECT_THROW(WithoutRule(by_hand, {.frame = "1", .note = "mine"}), Error);
  EXPECT_THROW(WithoutRule("a: 1\n", {.frame = "1"}), Error);
  EXPECT_THROW(WithRule("exclude: [{frame: a}]\n", {.frame = "b"}), Error);
}

using ProjectFolder = Folder;

TEST_F(ProjectFolder, UndoesAndRedoesOverARestart) {
  Write("session.yaml", "one\n");
  {
    Project project(folder_);
    EXPECT_FALSE(project.ReadVersion().undo);
    ASSERT_TRUE(project.Write("two\n", ""));
    ASSERT_TRUE(project.Write("three\n", ""));
    EXPECT_EQ(project.Undo()->text, "two\n");
    EXPECT_TRUE(project.ReadVersion().undo);
  }
  Project project(folder_);
  EXPECT_TRUE(project.ReadVersion().redo);
  EXPECT_EQ(project.Redo()->text, "three\n");
  EXPECT_EQ(project.Undo()->text, "two\n");
  EXPECT_EQ(project.Undo()->text, "one\n");
  EXPECT_FALSE(project.Undo());
  EXPECT_EQ(Read("session.yaml"), "one\n");
}

TEST_F(ProjectFolder, KeepsALinkToItsSession) {
  Write("shared.yaml", "one\n");
  fs::create_symlink("shared.yaml", folder_ / "session.yaml");
  Project project(folder_);
  ASSERT_TRUE(project.Write("two\n", ""));
  EXPECT_TRUE(fs::is_symlink(folder_ / "session.yaml"));
  EXPECT_EQ(Read("shared.yaml"), "two\n");
}

TEST_F(ProjectFolder, WaitsForAnEditorThatEmptiesTheFileBeforeItWrites) {
  Write("session.yaml", "plenocal: 1\n");
  Project project(folder_);
  EXPECT_EQ(project.ReadVersion().text, "plenocal: 1\n");
  Write("session.yaml", "");
  std::thread editor([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    Write("session.yaml", "plenocal: 2\n");
  });
  EXPECT_EQ(project.ReadVersion().text, "plenocal: 2\n");
  editor.join();
  EXPECT_EQ(project.Undo()->text, "plenocal: 1\n");
}

TEST_F(ProjectFolder, RefusesToWriteOverWhatAnEditorWrote) {
  Write("session.yaml", "one\n");
  Project project(folder_);
  const std::string hash = project.ReadVersion().hash;
  Write("session.yaml", "by an editor\n");
  EXPECT_FALSE(project.Write("two\n", hash));
  EXPECT_EQ(Read("session.yaml"), "by an editor\n");
  // The editor's text is a version like any other.
  ASSERT_TRUE(project.Write("two\n", project.ReadVersion().hash));
  EXPECT_EQ(project.Undo()->text, "by an editor\n");
  EXPECT_EQ(project.Undo()->text, "one\n");
}

TEST_F(ProjectFolder, ComesBackFromAnySequenceOfEditsAndUndos) {
  Write("session.yaml", "0\n");
  std::mt19937 dice(5);
  Project project(folder_);
  std::vector<std::string> undo, redo;
  std::string now = project.ReadVersion().text;
  for (int i = 1; i <= 200; ++i) {
    const auto choice = dice() % 4;
    if (choice == 0 && !undo.empty()) {
      redo.push_back(now);
      now = undo.back();
      undo.pop_back();
      ASSERT_EQ(project.Undo()->text, now);
    } else if (choice == 1 && !redo.empty()) {
      undo.push_back(now);
      now = redo.back();
      redo.pop_back();
      ASSERT_EQ(project.Redo()->text, now);
    } else {
      undo.push_back(now);
      redo.clear();
      now = std::to_string(i) + "\n";
      if (choice == 2) {
        ASSERT_TRUE(project.Write(now, ""));
      } else {
        Write("session.yaml", now);
        ASSERT_EQ(project.ReadVersion().text, now);
      }
    }
    ASSERT_EQ(Read("session.yaml"), now);
  }
}

TEST_F(ProjectFolder, IsOfOneWorkbenchAtATime) {
  const Project project(folder_);
  EXPECT_THROW(Project second(folder_), Error);
}

TEST_F(ProjectFolder, ListsItsRuns) {
  Write("runs/2/calibration.yaml", "");
  Write("runs/10/calibration.yaml", "");
  Write("runs/3/other", "");
  Write("runs/x1/calibration.yaml", "");
  const Project project(folder_);
  EXPECT_THAT(project.Runs(), ElementsAre(2, 10));
  EXPECT_EQ(project.NextRun(), 1);
  EXPECT_THROW(Project(folder_ / "none"), Error);
}

TEST(WorkerStatus, HasAFailureThatIsNeverEmpty) {
  constexpr int kSignalled = 128;
  EXPECT_THAT(FailureOf(kSignalled + SIGSEGV), HasSubstr("signal 11 (Segmentation fault)"));
  EXPECT_THAT(FailureOf(kSignalled + SIGKILL), HasSubstr("was the memory full?"));
  EXPECT_THAT(FailureOf(3), HasSubstr("without a message (exit status 3)"));
}

TEST(CommandLineText, IsTakenByAShellAsItWas) {
  EXPECT_EQ(CommandLineText({"calibrate", "a b.yaml", "$(touch x)", "it's", ""}),
            "plenocal calibrate 'a b.yaml' '$(touch x)' 'it'\\''s' ''");
}

}  // namespace TEST_FILE
}  // namespace plenocal::workbench
