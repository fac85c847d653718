// SPDX-License-Identifier: Apache-2.0
#include "calib/files/frame_images.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "calib/base/error.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class FrameImages : public ::testing::Test {
 protected:
  FrameImages() {
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
    for (const char* name : {"a2.JPG", "a1.png", "b1.png", "notes.txt", ".hidden.png"}) {
      std::ofstream(folder_ / name) << "x";
    }
  }
  ~FrameImages() override { std::filesystem::remove_all(folder_); }

  [[nodiscard]] std::string Path(const std::string& name) const {
    return (folder_ / name).string();
  }
  [[nodiscard]] std::vector<std::string> Frames(const std::vector<std::string>& patterns) const {
    std::vector<std::string> frames;
    for (const FrameImage& image : ExpandImages(patterns, "left: images")) {
      frames.push_back(image.frame);
    }
    return frames;
  }

  std::filesystem::path folder_ = std::filesystem::path(::testing::TempDir()) /
                                  ::testing::UnitTest::GetInstance()->current_test_info()->name();
};

TEST_F(FrameImages, OfAFolderAreItsImagesByName) {
  EXPECT_THAT(Frames({folder_.string()}), ElementsAre("a1", "a2", "b1"));
}

TEST_F(FrameImages, OfAListAreThoseOfItsPatterns) {
  EXPECT_THAT(Frames({Path("b*.png"), Path("a2.JPG")}), ElementsAre("1", "a2"));
}

TEST_F(FrameImages, MustBeToldApart) {
  try {
    (void)Frames({Path("a*.png"), Path("b*.png")});
    FAIL() << "two images of frame 1";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("both belong to frame '1'"));
  }
}

TEST_F(FrameImages, MustBeThere) {
  std::filesystem::create_directory(folder_ / "empty");
  for (const std::string& pattern : {Path("c*.png"), Path("empty")}) {
    EXPECT_THROW((void)Frames({pattern}), Error) << pattern;
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
