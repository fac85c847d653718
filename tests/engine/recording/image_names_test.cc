// SPDX-License-Identifier: Apache-2.0
//
// Globs of image files, frames in common, and the paths of a session; the files are empty.
#include "engine/recording/image_names.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

namespace fs = std::filesystem;
using ::testing::ElementsAre;

class ImageNames : public InTemporaryFolder {
 protected:
  void Make(const std::vector<std::string>& files) const {
    for (const std::string& file : files) Write(file, "");
  }
  [[nodiscard]] std::string In(const std::string& name) const { return Path(name).string(); }
  [[nodiscard]] std::vector<std::string> All(std::vector<std::string> names) const {
    for (std::string& name : names) name = In(name);
    return names;
  }
  /// The glob of files that are made, if it matches others with an 'x' alone.
  [[nodiscard]] std::string Glob(const std::vector<std::string>& names) const {
    Make(names);
    std::vector<FrameImage> files;
    for (const std::string& name : names) files.push_back({.frame = {}, .path = Path(name)});
    const std::string glob = GlobOf(files, [](const fs::path& path) {
      return path.string().find('x', path.string().size() - 8) != std::string::npos;
    });
    return glob.empty() ? glob : fs::path(glob).lexically_relative(folder_).string();
  }
  /// The images of cameras c0, c1 ... after they share their frames.
  [[nodiscard]] std::vector<std::vector<std::string>> Shared(
      std::vector<std::vector<std::string>> images) const {
    std::vector<std::string> names;
    for (std::vector<std::string>& patterns : images) {
      patterns = All(patterns);
      names.push_back(fmt::format("c{}", names.size()));
    }
    ShareFrames(names, &images);
    for (std::vector<std::string>& patterns : images) {
      for (std::string& each : patterns) each = fs::path(each).lexically_relative(folder_).string();
    }
    return images;
  }
};

using Images = std::vector<std::vector<std::string>>;

// ---- globs

TEST_F(ImageNames, HaveAGlobWhereOnePartDiffers) {
  EXPECT_EQ(Glob({"a/l1_cam.png", "a/l22_cam.png"}), "a/l*_cam.png");
  // A number is never cut.
  EXPECT_EQ(Glob({"b/img10.png", "b/img11.png"}), "b/img*.png");
  EXPECT_EQ(Glob({"c/1_7.png", "c/2_7.png"}), "c/*_7.png");
  EXPECT_EQ(Glob({"d/17.png", "d/27.png"}), "d/*.png");
  EXPECT_EQ(Glob({"e/a.png", "e/ab.png"}), "e/a*.png");
  EXPECT_EQ(Glob({"g/a.png", "g/aa.png"}), "g/a*.png");
  EXPECT_EQ(Glob({"f/left.png", "f/left_2.jpg"}), "f/left*g");
}

TEST_F(ImageNames, HaveNoGlobThatMatchesOthers) {
  EXPECT_EQ(Glob({"a/l1.png"}), "");
  EXPECT_EQ(Glob({}), "");
  EXPECT_EQ(Glob({"a/l1.png", "b/l2.png"}), "");
  EXPECT_EQ(Glob({"b/l2.png", "c/l1.png", "b/l3.png"}), "");
  Make({"d/l3.png"});
  EXPECT_EQ(Glob({"d/l1.png", "d/l2.png"}), "");
  Make({"e/lx3.png"});
  EXPECT_EQ(Glob({"e/l1.png", "e/l2.png"}), "e/l*.png");
  for (const char* name : {"[", "?", "*"}) {
    const std::string text = name;
    EXPECT_EQ(Glob({"g" + text + "/1.png", "g" + text + "/2.png"}), "") << name;
    EXPECT_EQ(Glob({"f/a" + text + "1.png", "f/a" + text + "2.png"}), "") << name;
    EXPECT_EQ(Glob({"f/1" + text + "b.png", "f/2" + text + "b.png"}), "") << name;
  }
}

TEST_F(ImageNames, OfOneCameraBecomeAGlob) {
  const auto globs = [&](const std::vector<std::string>& names) {
    return AsGlobs(All(names), "left");
  };
  Make({"l/a1.png", "l/a2.png", "r/b1.png", "z/a.zip"});
  EXPECT_EQ(globs({"l/a1.png", "l/a2.png"}), All({"l/a*.png"}));
  EXPECT_EQ(globs({"l/a1.png"}), All({"l/a1.png"}));
  EXPECT_EQ(globs({"l"}), All({"l"}));
  EXPECT_EQ(globs({"l/*.png"}), All({"l/*.png"}));
  EXPECT_EQ(globs({"l", "r"}), All({"l", "r"}));
  EXPECT_EQ(globs({"none[1].png"}), All({"none[1].png"}));
  Make({"l/a3.png"});
  EXPECT_EQ(globs({"l/a1.png", "l/a2.png"}), All({"l/a1.png", "l/a2.png"}));
  EXPECT_EQ(globs({"z/a.zip/left", "none"}), All({"z/a.zip/left", "none"}));
  EXPECT_EQ(RefusalOf([&] {
              globs({"l/a1.png", "none.png"});
            }),
            In("none.png") + ": no such file or folder; check the path");
}

// ---- frames in common

TEST_F(ImageNames, ThatShareFramesStay) {
  Make({"l/1.png", "l/2.png", "r/1.png", "r/2.png", "r/3.png", "z/a.zip"});
  EXPECT_EQ(Shared({{"l"}, {"r"}}), (Images{{"l"}, {"r"}}));
  EXPECT_EQ(Shared({{"l"}}), (Images{{"l"}}));
  for (const char* name : {"l", "r"}) {
    for (int i = 1; i < 10; ++i) Write(fmt::format("{0}2/{0}{1}.png", name, i), "");
    Make({std::string(name) + "2/a.png", std::string(name) + "2/b.png"});
  }
  EXPECT_EQ(Shared({{"l2"}, {"r2"}}), (Images{{"l2"}, {"r2"}}));
  EXPECT_EQ(Shared({{"none"}}), (Images{{"none"}}));
  EXPECT_EQ(Shared({{"z/a.zip/l"}, {"none"}}), (Images{{"z/a.zip/l"}, {"none"}}));
  EXPECT_EQ(Shared({{"none"}, {"l", "z/a.zip/l"}}), (Images{{"none"}, {"l", "z/a.zip/l"}}));
}

TEST_F(ImageNames, ShareFramesByWhatDiffers) {
  Make({"l/left1.png", "l/left2.png", "r/right1.png", "r/right2.png", "t/top2.png", "t/top3.png"});
  EXPECT_EQ(Shared({{"l"}, {"r"}}), (Images{{"l/left*.png"}, {"r/right*.png"}}));
  EXPECT_EQ(Shared({{"l"}, {"r"}, {"t"}}),
            (Images{{"l/left*.png"}, {"r/right*.png"}, {"t/top*.png"}}));
  // One that is in both already, and two by globs.
  Make({"l/wall.png", "r/wall.png"});
  Make({"l/left3.png", "l/left4.png", "r/right3.png", "r/right4.png"});
  EXPECT_EQ(Shared({{"l"}, {"r"}}), (Images{{"l/left*.png"}, {"r/right*.png"}}));
  // Globs that share no more than the names do not replace them.
  Make({"p/a7.png", "p/same.png", "q/b8.png", "q/same.png"});
  EXPECT_EQ(Shared({{"p"}, {"q"}}), (Images{{"p"}, {"q"}}));
}

TEST_F(ImageNames, ShareFramesBesideOthersUpToAQuarter) {
  Make({"l/left1.png", "l/left2.png", "l/left3.png", "l/wall.png"});
  Make({"r/right1.png", "r/right2.png", "r/right3.png", "r/right4.png"});
  EXPECT_EQ(Shared({{"l"}, {"r"}}), (Images{{"l/left*.png"}, {"r/right*.png"}}));
  // The glob may match the others.
  Make({"n/left1.png", "n/left2.png", "n/left3.png", "n/left_wall.png"});
  EXPECT_EQ(Shared({{"n"}, {"r"}}), (Images{{"n/left*.png"}, {"r/right*.png"}}));
  // Two of seven are too many: the glob is that of all.
  Make({"m/left1.png", "m/left2.png", "m/left3.png", "m/left4.png", "m/left5.png"});
  Make({"m/wall.png", "m/roof.png"});
  EXPECT_THAT(RefusalOf([&] {
                static_cast<void>(Shared({{"m"}, {"r"}}));
              }),
              ::testing::StartsWith("the cameras' images have no frame in common (c0 has 'left1', "
                                    "c1 has 'right1')"));
  Make({"m/left6.png"});
  EXPECT_EQ(Shared({{"m"}, {"r"}}), (Images{{"m/left*.png"}, {"r/right*.png"}}));
}

TEST_F(ImageNames, WithoutFramesInCommonAreRefused) {
  Make({"l/1.png", "l/2.png", "r/1.png", "r/2.png", "t/a.png", "t/b.png"});
  EXPECT_EQ(RefusalOf([&] {
              static_cast<void>(Shared({{"l"}, {"r"}, {"t"}}));
            }),
            "the cameras' images have no frame in common (c0 has '1', c1 has '1', c2 has 'a'): "
            "images of one instant have equal names, or equal parts where a glob's last '*' "
            "stands");
}

// ---- paths of a session

TEST_F(ImageNames, AreRelativeToTheSessionInItsNotation) {
  Make({"a/1.png", "b/2.png"});
  const auto yaml = [&](const std::string& name, const std::string& folder) {
    return PathsYaml({In(name)}, Path(folder));
  };
  EXPECT_EQ(yaml("a/1.png", "a"), "1.png");
  EXPECT_EQ(yaml("a", "b"), "../a/");
  EXPECT_EQ(yaml("a/1.png", ""), "a/1.png");
  EXPECT_EQ(yaml("a/1.png", "b"), "../a/1.png");
  EXPECT_EQ(yaml("a/x/../*_0-1.png", "b"), "../a/*_0-1.png");
  EXPECT_EQ(yaml("a/*/b.*", "a/none/deep"), "../../*/b.*");
  EXPECT_EQ(yaml("a/*/b.png", "b"), "../a/*/b.png");
  EXPECT_EQ(PathsYaml({"/*.png"}, folder_), "/*.png");
  // What has another meaning in YAML is quoted.
  EXPECT_EQ(yaml("a/*.png", "a"), "\"*.png\"");
  EXPECT_EQ(yaml("a/-1.png", "a"), "\"-1.png\"");
  EXPECT_EQ(yaml("a/?.png", ""), "\"a/?.png\"");
  EXPECT_EQ(yaml("a/l 1: \"x\".png", ""), "\"a/l 1: \\\"x\\\".png\"");
  // The whole path where the root alone is common.
  EXPECT_EQ(PathsYaml({"/proc/x.png"}, folder_), "/proc/x.png");
  EXPECT_EQ(PathsYaml({In("a/1.png"), In("b/2.png")}, Path("a")),
            "\n      - 1.png\n      - ../b/2.png");
  EXPECT_EQ(PathsYaml({}, Path("a")), "");
  EXPECT_THAT(RefusalOf([&] { static_cast<void>(yaml("a/\xff.png", "a")); }),
              ::testing::EndsWith(": the path is not UTF-8, as a session is; rename it"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
