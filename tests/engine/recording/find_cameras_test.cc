// SPDX-License-Identifier: Apache-2.0
//
// Cameras by the names of folders and files; the files are empty.
#include "engine/recording/find_cameras.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>

#include <string>
#include <vector>

#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

class Folders : public InTemporaryFolder {
 protected:
  void Make(const std::vector<std::string>& files) const {
    for (const std::string& file : files) Write(file, "");
  }
  /// Files of a format with a number: "left{}.png".
  template <typename Format>
  void Number(const Format& format, int first, int last) const {
    for (int i = first; i <= last; ++i) Write(fmt::format(fmt::runtime(format), i), "");
  }
  [[nodiscard]] std::string Relative(const std::filesystem::path& path) const {
    return path.lexically_relative(folder_).string();
  }
  /// "name count: images" of each, and "< count of white images: where" where it has some.
  [[nodiscard]] std::vector<std::string> Shown(const std::vector<FoundCamera>& cameras) const {
    std::vector<std::string> shown;
    for (const FoundCamera& camera : cameras) {
      std::string& text = shown.emplace_back(fmt::format("{} {}:", camera.name, camera.count));
      for (const std::string& image : camera.images) text += " " + Relative(image);
      if (camera.white_count > 0) text += fmt::format(" < {}:", camera.white_count);
      for (const std::string& white : camera.white) text += " " + Relative(white);
    }
    return shown;
  }
  [[nodiscard]] std::vector<std::string> Found() const { return Shown(FindCameras(folder_)); }
  [[nodiscard]] std::vector<std::string> In(const std::string& folder) const {
    return Shown(CamerasInFolder(Path(folder)));
  }
  [[nodiscard]] std::vector<std::string> NamesIn(const std::string& folder) const {
    std::vector<std::string> names;
    for (const FoundCamera& camera : CamerasInFolder(Path(folder))) names.push_back(camera.name);
    return names;
  }
};

// ---- names that differ in their text

TEST_F(Folders, WithNamesThatShareTheirNumbersHaveACameraOfEachText) {
  Make({"left01.jpg", "left02.jpg", "left03.jpg", "right01.jpg", "right02.jpg", "right03.jpg"});
  const std::vector<std::string> cameras{"left 3: left*.jpg", "right 3: right*.jpg"};
  EXPECT_EQ(In(""), cameras);
  EXPECT_EQ(Found(), cameras);
  EXPECT_EQ(Shown(FindCameras(folder_ / "")), cameras);
}

TEST_F(Folders, HaveTwoToSixteenCameras) {
  for (char c = 'a'; c <= 'p'; ++c) Number(std::string(1, c) + "{}.png", 1, 2);
  EXPECT_EQ(NamesIn("").size(), 16U);
  EXPECT_EQ(NamesIn("").back(), "p");
  Number("q{}.png", 1, 2);
  EXPECT_THAT(In(""), ElementsAre("cam 34: ."));
}

TEST_F(Folders, HaveCamerasThatShareHalfOfTheFramesOfTheSmaller) {
  const auto names = [&](int first, int last, int last_left) {
    const std::string folder = fmt::format("{}_{}_{}", first, last, last_left);
    Number(folder + "/left{}.png", 1, last_left);
    Number(folder + "/right{}.png", first, last);
    return NamesIn(folder);
  };
  EXPECT_THAT(names(1, 1, 2), ElementsAre("cam"));
  EXPECT_THAT(names(2, 3, 2), ElementsAre("left", "right"));
  EXPECT_THAT(names(3, 6, 4), ElementsAre("left", "right"));
  EXPECT_THAT(names(4, 7, 4), ElementsAre("cam"));
  EXPECT_THAT(names(5, 7, 5), ElementsAre("cam"));
  EXPECT_THAT(names(8, 12, 12), ElementsAre("left", "right"));
  EXPECT_THAT(names(7, 8, 7), ElementsAre("left", "right"));
  EXPECT_THAT(names(8, 9, 7), ElementsAre("cam"));
}

TEST_F(Folders, MayHoldOtherImagesLessThanAQuarterOfACamera) {
  Number("left{}.png", 1, 4);
  Number("right{}.png", 1, 4);
  Make({"left_wall.png"});
  EXPECT_THAT(In(""), ElementsAre("cam 9: ."));
  Number("left{}.png", 5, 5);
  EXPECT_THAT(In(""), ElementsAre("left 5: left*.png", "right 4: right*.png"));
}

TEST_F(Folders, WithImagesThatNoGlobTellsApartListThem) {
  Number("a{}.png", 1, 6);
  Number("ab{}.png", 1, 6);
  EXPECT_THAT(In(""),
              ElementsAre("a 6: a1.png a2.png a3.png a4.png a5.png a6.png", "ab 6: ab*.png"));
  Make({"log/left1.png", "log/left2.jpg", "log/left_of.log", "log/right1.png", "log/right2.png"});
  EXPECT_THAT(In("log"),
              ElementsAre("left 2: log/left1.png log/left2.jpg", "right 2: log/right*.png"));
}

TEST_F(Folders, NameCamerasByTheWordsInWhichTheyDiffer) {
  int run = 0;
  const auto names = [&](const std::string& a, const std::string& b) {
    const std::string folder = std::to_string(++run);
    for (const std::string& each : {a, b}) Number(folder + "/" + each + ".png", 1, 2);
    return fmt::format("{}", fmt::join(NamesIn(folder), " "));
  };
  EXPECT_EQ(names("img_left_{}", "img_right_{}"), "left right");
  EXPECT_EQ(names("img_left_of_{}", "img_lot_of_{}"), "left lot");
  EXPECT_EQ(names("left_of_{}", "right_of_{}"), "left right");
  EXPECT_EQ(names("cam{}", "cam_b{}"), "cam cam_b");
  EXPECT_EQ(names("img{}", "img{}b"), "cam b");
  EXPECT_EQ(names("{}_l-_-", "{}_r-_-"), "l r");
  EXPECT_EQ(names("{}-_-l t", "{}-_-r_-t"), "lt r_-t");
  // Names that are the same get numbers.
  EXPECT_EQ(names("img.{}", "img!{}"), "img img2");
  EXPECT_EQ(names("{}.", "{}!"), "cam cam2");
  Number("three/a.{}.png", 1, 2);
  Number("three/a!{}.png", 1, 2);
  Number("three/a+{}.png", 1, 2);
  EXPECT_THAT(NamesIn("three"), ElementsAre("a", "a2", "a3"));
}

// ---- names that differ in a number

TEST_F(Folders, WithANumberAfterAWordForCamerasHaveACameraOfEachNumber) {
  const auto names = [&](const std::string& format) {
    for (const int camera : {0, 1}) {
      for (const int frame : {7, 8}) {
        Write(fmt::format(
                  "{0}/{1}.png",
                  format,
                  fmt::format(fmt::runtime(format), fmt::arg("c", camera), fmt::arg("f", frame))),
              "");
      }
    }
    return fmt::format("{}", fmt::join(NamesIn(format), " "));
  };
  for (const char* format : {"{f:03}_cam{c}",
                             "cam{c}_{f}",
                             "CAM{c}_{f}",
                             "my_camera{c}-{f}",
                             "view_{c}_{f}",
                             "{f}sensor--{c}x",
                             "{f}cam{c}",
                             "{f}_cam{c}left",
                             "a{f}_b7_cam {c}"}) {
    EXPECT_EQ(names(format), "cam0 cam1") << format;
  }
  for (const char* format : {"scan{c}_{f}", "cams{c}_{f}", "{f}_x{c}", "{c}_{f}cam"})
    EXPECT_EQ(names(format), "cam") << format;
  EXPECT_THAT(In("{f:03}_cam{c}"),
              ElementsAre("cam0 2: {f:03}_cam{c}/*_cam0.png", "cam1 2: {f:03}_cam{c}/*_cam1.png"));
}

TEST_F(Folders, WithOtherImagesUpToAQuarterHaveCamerasByNumber) {
  Number("cam0_{}.png", 1, 3);
  Number("cam1_{}.png", 1, 2);
  Make({"x.png", "y.png"});
  EXPECT_THAT(In(""), ElementsAre("cam 7: ."));
  Number("cam1_{}.png", 3, 3);
  EXPECT_THAT(In(""), ElementsAre("cam0 3: cam0_*.png", "cam1 3: cam1_*.png"));
}

TEST_F(Folders, WithADigitBeforeTheSameNumbersHaveACameraOfEachDigit) {
  int run = 0;
  // Names of the cameras of pictures img_<camera>_<first> to _<last>.
  struct Camera {
    std::string number;
    int first, last;
  };
  const auto names = [&](const std::vector<Camera>& cameras) {
    const std::string folder = std::to_string(++run);
    for (const Camera& camera : cameras) {
      Number(folder + "/img_" + camera.number + "_{}.jpg", camera.first, camera.last);
    }
    return fmt::format("{}", fmt::join(NamesIn(folder), " "));
  };
  EXPECT_EQ(names({{"1", 10, 18}}), "cam");
  EXPECT_EQ(names({{"1", 10, 18}, {"2", 10, 18}}), "cam1 cam2");
  EXPECT_EQ(names({{"0", 10, 14}, {"1", 10, 14}}), "cam0 cam1");
  EXPECT_EQ(names({{"1", 10, 13}, {"2", 10, 13}}), "cam");
  EXPECT_EQ(names({{"2", 10, 18}, {"3", 10, 18}}), "cam");
  EXPECT_EQ(names({{"1", 10, 18}, {"3", 10, 18}}), "cam");
  EXPECT_EQ(names({{"01", 10, 18}, {"02", 10, 18}}), "cam");
  // Nine tenths of the frames of the larger.
  EXPECT_EQ(names({{"1", 10, 19}, {"2", 11, 19}}), "cam1 cam2");
  EXPECT_EQ(names({{"1", 10, 19}, {"2", 12, 19}}), "cam");
  EXPECT_EQ(names({{"1", 11, 19}, {"2", 10, 19}}), "cam1 cam2");
  EXPECT_EQ(names({{"1", 12, 19}, {"2", 10, 19}}), "cam");
  // Five exposures of each of some scenes are no rig.
  std::vector<Camera> scenes;
  for (const char* number : {"1", "2", "3", "4"}) scenes.push_back({number, 10, 14});
  EXPECT_EQ(names(scenes), "cam1 cam2 cam3 cam4");
  scenes.push_back({"5", 10, 14});
  EXPECT_EQ(names(scenes), "cam");
}

// ---- folders

TEST_F(Folders, OfOneNameAreToldApartByThoseAbove) {
  Make({"cam0/data/1.png", "cam0/data/2.png", "cam1/data/1.png", "cam1/data/2.png"});
  EXPECT_THAT(Found(), ElementsAre("cam0 2: cam0/data", "cam1 2: cam1/data"));
}

TEST_F(Folders, HaveTheNamesInWhichTheyDiffer) {
  const auto names = [&](const std::string& top, const std::vector<std::string>& folders) {
    for (const std::string& folder : folders) Write(fmt::format("{}/{}/1.png", top, folder), "");
    std::vector<std::string> found;
    for (const FoundCamera& camera : FindCameras(Path(top))) found.push_back(camera.name);
    return fmt::format("{}", fmt::join(found, " "));
  };
  EXPECT_EQ(names("general", {"left/images", "right/frames"}), "left right");
  EXPECT_EQ(names("one", {"images"}), "cam");
  EXPECT_EQ(names("other", {"wide"}), "wide");
  EXPECT_EQ(names("none", {"a/data", "b/a/data"}), "data b");
  EXPECT_EQ(names("clean", {"-l!1_", "_-r2-"}), "l1 r2");
  EXPECT_EQ(names("same", {"l!", "l$", "l%"}), "l l2 l3");
  EXPECT_EQ(names("empty", {"!", "$"}), "cam cam2");
  EXPECT_EQ(names("many", {"h", "c", "a", "g", "b", "i", "d", "f", "e"}), "a b c d e f g h i");
  for (const char* name : {"data", "images", "image", "imgs", "img", "frames", "raw"})
    EXPECT_EQ(names(std::string("is ") + name, {name}), "cam") << name;
}

TEST_F(Folders, OfSeveralCamerasKeepTheirNames) {
  Make({"top1.png", "pair/left1.png", "pair/left2.png", "pair/right1.png", "pair/right2.png"});
  EXPECT_THAT(Found(),
              ElementsAre("cam 1: .", "left 2: pair/left*.png", "right 2: pair/right*.png"));
}

TEST_F(Folders, AreSearchedThreeDeep) {
  Make({"a/b/c/1.png", "d/e/f/g/1.png"});
  EXPECT_THAT(Found(), ElementsAre("c 1: a/b/c"));
}

TEST_F(Folders, OfResultsAndHiddenOnesHoldNoCameras) {
  Make({"left/1.png", "out/calibration.yaml", "out/picture.png", ".cache/1.png", "text/1.txt"});
  EXPECT_THAT(Found(), ElementsAre("left 1: left"));
}

TEST_F(Folders, CalledWhiteHoldTheWhiteImagesOfTheFolderBeside) {
  Make({"left/1.png", "mono/1.png", "mono/2.png", "mono_white/a.png", "mono_white/b.png"});
  EXPECT_THAT(Found(), ElementsAre("left 1: left", "mono 2: mono < 2: mono_white"));
  Make({"left-Whites/a.png"});
  EXPECT_THAT(Found(),
              ElementsAre("left 1: left < 1: left-Whites", "mono 2: mono < 2: mono_white"));
  Make({"left_of/1.png", "left_of_white_images/a.png", "snow-white/1.png", "snow/1.png"});
  EXPECT_THAT(Found(),
              ElementsAre("left 1: left < 1: left-Whites",
                          "left_of 1: left_of < 1: left_of_white_images",
                          "mono 2: mono < 2: mono_white",
                          "snow 1: snow < 1: snow-white"));
}

TEST_F(Folders, CalledWhiteMayLieInThatOfTheirCamera) {
  Make({"a/1.png", "a/white/w.png", "b/images/1.png", "b/white-images/w.png"});
  EXPECT_THAT(Found(), ElementsAre("a 1: a < 1: a/white", "b 1: b/images < 1: b/white-images"));
  Make({"c/1.png", "c/_white/w.png", "d/frames/1.png", "d_white/w.png"});
  EXPECT_THAT(Found(),
              ElementsAre("a 1: a < 1: a/white",
                          "b 1: b/images < 1: b/white-images",
                          "c 1: c < 1: c/_white",
                          "d 1: d/frames < 1: d_white"));
}

TEST_F(Folders, CalledWhiteBelongToNoOther) {
  Make({"a/left/1.png", "a_white/w.png", "images/1.png", "b_white/w.png"});
  for (const FoundCamera& camera : FindCameras(folder_)) EXPECT_THAT(camera.white, IsEmpty());
  Make({"only/a/1.png", "only/x_white/w.png"});
  EXPECT_THAT(Shown(FindCameras(Path("only"))), ElementsAre("a 1: only/a < 1: only/x_white"));
  Make({"pair/l1.png", "pair/l2.png", "pair/r1.png", "pair/r2.png", "pair/x_white/w.png"});
  EXPECT_THAT(Shown(FindCameras(Path("pair"))),
              ElementsAre("l 2: pair/l*.png", "r 2: pair/r*.png"));
  // Neither a part of a word nor the given folder itself.
  Make({"words/bobwhite/1.png", "words/whitest/1.png", "white/1.png"});
  EXPECT_THAT(Shown(FindCameras(Path("words"))),
              ElementsAre("bobwhite 1: words/bobwhite", "whitest 1: words/whitest"));
  EXPECT_THAT(Shown(FindCameras(Path("white"))), ElementsAre("cam 1: white"));
}

TEST_F(Folders, WithoutImagesAreRefused) {
  Make({"notes.txt"});
  EXPECT_EQ(RefusalOf([&] { FindCameras(folder_ / ""); }),
            folder_.string() + ": no images (png, tiff, jpeg, bmp, pgm) in this folder or below");
  EXPECT_EQ(RefusalOf([&] { CamerasInFolder(folder_); }),
            folder_.string() +
                ": no images (png, tiff, jpeg, bmp, pgm) in this folder; give a folder below it, "
                "or find the cameras by 'plenocal init'");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
