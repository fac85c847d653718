// SPDX-License-Identifier: Apache-2.0
//
// Cameras by the names of folders and files; the files are empty.
#include "engine/recording/find_cameras.h"

#include <gmock/gmock.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "calib/base/error.h"
#include "engine/recording/image_names.h"

namespace plenocal::testing {
namespace TEST_FILE {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::IsEmpty;

class Folders : public ::testing::Test {
 protected:
  Folders() { fs::create_directories(folder_); }
  ~Folders() override { fs::remove_all(folder_); }

  void Make(const std::vector<std::string>& files) const {
    for (const std::string& file : files) {
      fs::create_directories((folder_ / file).parent_path());
      std::ofstream(folder_ / file) << "";
    }
  }
  [[nodiscard]] std::vector<std::string> Names() const {
    std::vector<std::string> names;
    for (const FoundCamera& camera : FindCameras(folder_)) names.push_back(camera.name);
    return names;
  }

  fs::path folder_ = fs::path(::testing::TempDir()) /
                     ("find_cameras_" +
                      std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
};

TEST_F(Folders, WithNamesThatShareTheirNumbersHaveACameraOfEachText) {
  Make({"left01.jpg", "left02.jpg", "left03.jpg", "right01.jpg", "right02.jpg", "right03.jpg"});
  const std::vector<FoundCamera> cameras = CamerasInFolder(folder_);
  ASSERT_EQ(cameras.size(), 2U);
  EXPECT_EQ(cameras[0].name, "left");
  EXPECT_EQ(cameras[1].name, "right");
  EXPECT_EQ(cameras[1].count, 3U);
  EXPECT_THAT(cameras[1].images, ElementsAre(EndsWith("right*.jpg")));
}

TEST_F(Folders, WithANumberAfterTheWordCamHaveACameraOfEachNumber) {
  Make({"001_cam0.png", "001_cam1.png", "002_cam0.png", "002_cam1.png"});
  EXPECT_THAT(Names(), ElementsAre("cam0", "cam1"));
}

TEST_F(Folders, WithADigitBeforeTheSameNumbersHaveACameraOfEachDigit) {
  const auto make = [&](int cameras, int images) {
    for (int c = 1; c <= cameras; ++c) {
      for (int i = 10; i < 10 + images; ++i) {
        Make({"img_" + std::to_string(c) + "_" + std::to_string(i) + ".jpg"});
      }
    }
  };
  make(1, 9);
  EXPECT_THAT(Names(), ElementsAre("cam"));
  make(2, 9);
  Make({"readme.png"});
  EXPECT_THAT(Names(), ElementsAre("cam1", "cam2"));
  EXPECT_THAT(CamerasInFolder(folder_)[1].images, ElementsAre(EndsWith("img_2_*.jpg")));
  // Five exposures of each of some scenes are no rig.
  make(9, 5);
  EXPECT_THAT(Names(), ElementsAre("cam"));
}

TEST_F(Folders, WithAFewOtherFilesShareTheFramesOfTheRest) {
  Make({"l/left01.jpg", "l/left02.jpg", "l/left03.jpg", "l/left04.jpg", "l/wall.jpg"});
  Make({"r/right01.jpg", "r/right02.jpg", "r/right03.jpg", "r/right04.jpg"});
  for (const bool alike : {false, true}) {
    if (alike) Make({"r/wall.jpg"});  // now one name is in both
    std::vector<std::vector<std::string>> images{{(folder_ / "l").string()},
                                                 {(folder_ / "r").string()}};
    ShareFrames({"l", "r"}, &images);
    EXPECT_THAT(images[0], ElementsAre(EndsWith("left*.jpg")));
    EXPECT_THAT(images[1], ElementsAre(EndsWith("right*.jpg")));
  }
}

TEST_F(Folders, OfOneNameAreToldApartByThoseAbove) {
  Make({"cam0/data/1.png", "cam0/data/2.png", "cam1/data/1.png", "cam1/data/2.png"});
  EXPECT_THAT(Names(), ElementsAre("cam0", "cam1"));
}

TEST_F(Folders, CalledWhiteHoldTheWhiteImagesOfTheFolderBeside) {
  Make({"left/1.png", "raw/1.png", "raw/2.png", "raw_white/a.png", "raw_white/b.png"});
  const std::vector<FoundCamera> cameras = FindCameras(folder_);
  ASSERT_EQ(cameras.size(), 2U);
  EXPECT_THAT(cameras[0].white, IsEmpty());
  EXPECT_THAT(cameras[1].white, ElementsAre(EndsWith("raw_white")));
  EXPECT_EQ(cameras[1].white_count, 2U);
}

TEST_F(Folders, OfResultsAndHiddenOnesHoldNoCameras) {
  Make({"left/1.png", "out/calibration.yaml", "out/picture.png", ".cache/1.png"});
  EXPECT_THAT(Names(), ElementsAre("left"));
}

TEST_F(Folders, WithoutImagesAreRefused) {
  Make({"notes.txt"});
  EXPECT_THROW(FindCameras(folder_), Error);
  EXPECT_THROW(CamerasInFolder(folder_), Error);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
