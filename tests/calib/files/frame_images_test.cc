// SPDX-License-Identifier: Apache-2.0
#include "calib/files/frame_images.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "calib/base/error.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class FrameImages : public testing::InTemporaryFolder {
 protected:
  FrameImages() {
    for (const char* name : {"a2.JPG", "a1.png", "b1.png", "notes.txt", ".hidden.png"}) {
      Write(name, "x");
    }
  }

  [[nodiscard]] std::vector<std::string> Frames(const std::vector<std::string>& patterns) const {
    std::vector<std::string> frames;
    for (const FrameImage& image : ExpandImages(patterns, "left: images")) {
      frames.push_back(image.frame);
    }
    return frames;
  }
};

TEST_F(FrameImages, OfAFolderAreItsImagesByName) {
  EXPECT_THAT(Frames({folder_.string()}), ElementsAre("a1", "a2", "b1"));
}

TEST_F(FrameImages, OfAListAreThoseOfItsPatterns) {
  EXPECT_THAT(Frames({Path("b*.png"), Path("a2.JPG")}), ElementsAre("1", "a2"));
}

TEST_F(FrameImages, MustBeToldApart) {
  EXPECT_THAT(testing::RefusalOf([&] {
                (void)Frames({Path("a*.png"), Path("b*.png")});
              }),
              HasSubstr("both belong to frame '1'"));
}

TEST_F(FrameImages, MustBeThere) {
  std::filesystem::create_directory(folder_ / "empty");
  for (const char* pattern : {"c*.png", "empty"}) {
    EXPECT_THROW((void)Frames({Path(pattern)}), Error) << pattern;
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
