// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/project/watch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "tests/temporary_folder.h"

namespace plenocal::workbench {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

class WatchOfAFolder : public testing::InTemporaryFolder {
 protected:
  WatchOfAFolder() {
    Write("session.yaml",
          "plenocal: 1\ntarget: target.yaml\ncameras:\n"
          "  left: {model: pinhole, images: left/*.png}\n"
          "  right: {model: pinhole, images: right/*.png}\n");
    Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 9\nrows: 6\nsquare: 0.025\n");
    project_.emplace(folder_);
    watch_.emplace(&*project_);
  }

  /// "camera frame" of what has arrived at a look half a second later.
  std::vector<std::string> Look() {
    std::this_thread::sleep_for(std::chrono::milliseconds(505));
    std::vector<std::string> names;
    for (const Arrival& arrival : watch_->Arrived()) {
      names.push_back(arrival.camera + " " + arrival.image.frame);
    }
    return names;
  }

  std::optional<Project> project_;
  std::optional<Watch> watch_;
};

TEST_F(WatchOfAFolder, SeesImagesOnceTheyAreWritten) {
  Write("left/a.png", "1");
  EXPECT_THAT(Look(), IsEmpty()) << "it has not begun";
  watch_->Start();
  EXPECT_TRUE(watch_->On());
  EXPECT_THAT(Look(), IsEmpty()) << "a file may still grow";
  Write("left/a.png", "12");
  EXPECT_THAT(Look(), IsEmpty()) << "and it does";
  EXPECT_THAT(Look(), ElementsAre("left a")) << "the folder of the right camera is not there yet";
  EXPECT_THAT(Look(), IsEmpty()) << "once";
  Write("right/a.png", "123");
  Write("left/b.png", "1");
  EXPECT_THAT(Look(), IsEmpty());
  EXPECT_THAT(watch_->Arrived(), IsEmpty()) << "too early";
  EXPECT_THAT(Look(), ElementsAre("left b", "right a"));
}

TEST_F(WatchOfAFolder, SeesAnImageAgainWhenItIsMadeAgain) {
  Write("left/a.png", "1");
  Write("left/b.png", "1");
  watch_->Start();
  Look();
  EXPECT_THAT(Look(), ElementsAre("left a", "left b"));
  Write("left/b.png", "123");
  EXPECT_THAT(Look(), IsEmpty());
  EXPECT_THAT(Look(), ElementsAre("left b"));
  watch_->Stop();
  EXPECT_FALSE(watch_->On());
  Write("left/c.png", "1");
  Look();
  EXPECT_THAT(Look(), IsEmpty());
}

}  // namespace TEST_FILE
}  // namespace plenocal::workbench
