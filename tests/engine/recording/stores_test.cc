// SPDX-License-Identifier: Apache-2.0
//
// Images in zip archives, and lists of images wherever they are.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include "calib/io/detection_cache.h"
#include "engine/recording/stores/image_lister.h"
#include "engine/recording/stores/zip_archive.h"
#include "tests/apps/recording/small_images.h"
#include "tests/engine/recording/message_bytes.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

class Stores : public InTemporaryFolder {
 protected:
  std::filesystem::path Zip(const std::string& name,
                            const std::map<std::string, std::string>& files) const {
    std::filesystem::create_directories(Path(name).parent_path());
    WriteZip(Path(name), files);
    return Path(name);
  }
  [[nodiscard]] std::string In(const std::string& name) const { return Path(name).string(); }
  /// "frame@path" of each.
  [[nodiscard]] std::vector<std::string> Shown(const std::vector<FrameImage>& images) const {
    std::vector<std::string> shown;
    for (const FrameImage& image : images) {
      shown.push_back(image.frame + "@" + image.path.lexically_relative(folder_).string());
    }
    return shown;
  }
  std::vector<std::string> List(std::vector<std::string> patterns) const {
    for (std::string& pattern : patterns) pattern = In(pattern);
    return Shown(ListImages(patterns, "left"));
  }
  static std::string Text(const StoredImage& image) {
    return {image.bytes.begin(), image.bytes.end()};
  }
  static constexpr const char* kNone = ": no image (png, tiff, jpeg, bmp, pgm) in ";
};

// ---- archives

TEST_F(Stores, HaveTheFilesOfAnArchive) {
  std::string large(300'000, ' ');
  for (size_t i = 0; i < large.size(); ++i) large[i] = static_cast<char>(i * i >> 7U);
  const ZipArchive archive(
      Zip("a.zip", {{"/top.png", "top"}, {"l/", ""}, {"l/1.png", "one"}, {"l/2.bin", large}}));
  EXPECT_EQ(archive.Path(), Path("a.zip"));
  EXPECT_THAT(archive.Names(), ElementsAre("top.png", "l/1.png", "l/2.bin"));
  EXPECT_EQ(archive.Place(1), In("a.zip/l/1.png"));
  EXPECT_EQ(Text(archive.Read(0)), "top");
  EXPECT_EQ(Text(archive.Read(1)), "one");
  EXPECT_EQ(archive.Read(1).encoding, "");
  EXPECT_EQ(Text(archive.Read(2)), large);
  for (const size_t most : {0U, 1U, 65'535U, 65'536U, 65'537U, 131'073U, 299'999U, 300'001U}) {
    EXPECT_EQ(Text(archive.Start(2, most)), large.substr(0, most)) << most;
  }
  EXPECT_EQ(Text(archive.Start(1, 2)), "on");
  EXPECT_EQ(archive.Hash(1), HashBytes(archive.Read(1).bytes));
}

TEST_F(Stores, ThatAreNoArchivesAreRefused) {
  EXPECT_THAT(
      RefusalOf([&] { ZipArchive archive(Write("a.zip", "PK no archive")); }),
      ::testing::MatchesRegex(In("a.zip") + ": is no zip archive that can be read \\(.*Not a zip "
                                            "archive.*\\); copy it again"));
  EXPECT_THAT(RefusalOf([&] { ZipArchive archive(Path("none.zip")); }), HasSubstr("none.zip"));
}

TEST_F(Stores, WithDamagedFilesRefuseThose) {
  std::string bytes, image(400, ' ');
  for (size_t i = 0; i < image.size(); ++i) image[i] = static_cast<char>(i * i * i >> 5U);
  Zip("a.zip", {{"1.png", image}, {"2.png", "two"}});
  bytes = files_.Read("a.zip");
  // In the content of the first file: the check sum of its bytes differs.
  std::string changed = bytes;
  changed[150] = static_cast<char>(changed[150] ^ 1);
  const ZipArchive damaged(Write("b.zip", changed));
  EXPECT_THAT(
      RefusalOf([&] { static_cast<void>(damaged.Read(0)); }),
      ::testing::MatchesRegex(In("b.zip/1.png") + ": is damaged \\(.+\\); pack the archive again"));
  EXPECT_EQ(damaged.Hash(0), "");
  EXPECT_EQ(Text(damaged.Read(1)), "two");
  // By its flag in the archive's directory the file is encrypted.
  changed = bytes;
  const size_t entry = changed.find("PK\x01\x02");
  changed[entry + 8] = '\1';
  const ZipArchive unopened(Write("c.zip", changed));
  EXPECT_THAT(RefusalOf([&] { static_cast<void>(unopened.Read(0)); }),
              ::testing::MatchesRegex(In("c.zip/1.png") +
                                      ": cannot be read \\(.+\\); pack the archive again"));
  changed = bytes;
  const size_t size = entry + 24;
  for (size_t i = 0; i < 4; ++i) changed[size + i] = i == 3 ? '\x7f' : '\0';
  const ZipArchive enormous(Write("d.zip", changed));
  EXPECT_EQ(RefusalOf([&] { static_cast<void>(enormous.Start(0, 10)); }),
            In("d.zip/1.png") + ": larger than 960 MB; is it an image?");
}

TEST_F(Stores, ListTheImagesOfAnArchive) {
  const std::filesystem::path zip = Zip("a.zip",
                                        {{"10.png", ""},
                                         {"9.pgm", ""},
                                         {"l/1.png", ""},
                                         {"l/deep/7.jpg", ""},
                                         {"note.txt", ""},
                                         {"text/a.txt", ""}});
  EXPECT_THAT(ImageFoldersIn(ZipArchive(zip)), ElementsAre("", "l", "l/deep"));
  EXPECT_THAT(
      Shown(ZipImages(zip, "", "left")),
      ElementsAre("1@a.zip/l/1.png", "7@a.zip/l/deep/7.jpg", "9@a.zip/9.pgm", "10@a.zip/10.png"));
  const std::vector<FrameImage> images = ZipImages(zip, "l", "left");
  EXPECT_THAT(Shown(images), ElementsAre("1@a.zip/l/1.png"));
  const auto* const store = dynamic_cast<const ZipArchive*>(images[0].store.get());
  ASSERT_NE(store, nullptr);
  EXPECT_EQ(store->Names()[images[0].index], "l/1.png");
  EXPECT_EQ(RefusalOf([&] { ZipImages(zip, "text", "left"); }),
            std::string("left") + kNone + "the folder text of " + zip.string());
  Zip("b.zip", {{"note.txt", ""}});
  EXPECT_EQ(RefusalOf([&] { ZipImages(Path("b.zip"), "", "left"); }),
            std::string("left") + kNone + In("b.zip"));
  Zip("c.zip", {{"a\nb.png", ""}});
  EXPECT_THAT(RefusalOf([&] { ZipImages(Path("c.zip"), "", "left"); }),
              StartsWith("left: " + In("c.zip/a\nb.png") + ": the name of its frame, "));
}

TEST_F(Stores, AreKnownByTheirNames) {
  for (const char* name : {"a.zip", "d/A.ZIP"}) EXPECT_TRUE(IsArchiveName(name)) << name;
  for (const char* name : {"zip", "a.zip.png", "a.Zip"}) EXPECT_FALSE(IsArchiveName(name)) << name;
  for (const char* name : {"a.zip", "a.avi", "a.mcap", "a.bag", "a.db3"})
    EXPECT_TRUE(IsStoreName(name)) << name;
  for (const char* name : {"a.png", "a", "a.txt"}) EXPECT_FALSE(IsStoreName(name)) << name;
}

TEST_F(Stores, AreClosedBehindTheirUse) {
  Zip("a.zip", {{"1.png", "one"}});
  Write("b.zip", "PK no archive");
  const auto open = [] {
    const std::filesystem::directory_iterator files("/proc/self/fd");
    return std::distance(begin(files), end(files));
  };
  const auto before = open();
  EXPECT_EQ(Text(ZipArchive(Path("a.zip")).Read(0)), "one");
  EXPECT_NE(RefusalOf([&] { ZipArchive archive(Path("b.zip")); }), "no refusal");
  EXPECT_EQ(open(), before);
}

// ---- patterns

TEST_F(Stores, BeginPatterns) {
  for (const char* file : {"a.zip", "d/b.zip", "day/metadata.yaml", "day/1.bag", "i/1.png"})
    Write(file, "");
  std::filesystem::create_directories(Path("folder.zip"));
  const auto split = [&](const std::string& pattern) {
    const StorePattern store = SplitStorePattern(Path(pattern));
    return store.file.empty() ? std::string("-")
                              : store.file.lexically_relative(folder_).string() + "|" + store.part;
  };
  EXPECT_EQ(split("a.zip"), "a.zip|");
  EXPECT_EQ(split("a.zip/"), "a.zip|");
  EXPECT_EQ(split("a.zip/l/m/"), "a.zip|l/m");
  EXPECT_EQ(split("d/b.zip/l"), "d/b.zip|l");
  EXPECT_EQ(split("day"), "day|");
  EXPECT_EQ(split("day/left/image"), "day|left/image");
  EXPECT_EQ(split("day/1.bag/left"), "day/1.bag|left");
  EXPECT_EQ(split("day/2.bag"), "day|2.bag");
  for (const char* pattern : {"i/1.png", "i", "none.zip", "folder.zip", "d", ""})
    EXPECT_EQ(split(pattern), "-") << pattern;
  EXPECT_EQ(SplitStorePattern("").file, "");
}

TEST_F(Stores, AreListedBeforeFiles) {
  Zip("a.zip", {{"l/1.png", ""}, {"r/1.png", ""}, {"r/2.png", ""}});
  for (const char* file : {"i/1.png", "i/3.png", "i/4.png"}) Write(file, "");
  EXPECT_THAT(List({"i/3.png", "a.zip/r/", "i/4.png"}),
              ElementsAre("1@a.zip/r/1.png", "2@a.zip/r/2.png", "3@i/3.png", "4@i/4.png"));
  EXPECT_THAT(List({"i"}), ElementsAre("1@i/1.png", "3@i/3.png", "4@i/4.png"));
  EXPECT_THAT(List({}), IsEmpty());
  EXPECT_EQ(RefusalOf([&] {
              List({"i", "a.zip/l"});
            }),
            "left: " + In("a.zip/l/1.png") + " and " + In("i/1.png") +
                " both belong to frame '1'; name one of them, or a folder of the archive, such as "
                "archive.zip/left");
  EXPECT_EQ(RefusalOf([&] { List({"a.zip/up"}); }),
            std::string("left") + kNone + "the folder up of " + In("a.zip"));
  Write("v.avi", "");
  EXPECT_EQ(RefusalOf([&] { List({"v.avi/left"}); }),
            "left: " + In("v.avi/left") + ": a video has no parts; give the video alone");
}

TEST_F(Stores, OfRecordingsAreReadOnce) {
  const auto image = [](std::uint32_t seconds) {
    return BagMessage(1, 100, 0, ImageMessage(MessageWriter::Form::kRos1, seconds, 0, 'a'));
  };
  const std::string bag =
      "#ROSBAG V2.0\n" + BagConnection(1, "/l/image", "sensor_msgs/Image") + image(2) + image(1);
  Write("a.bag", bag);
  ImageLister lister;
  const auto list = [&] { return lister.List({In("a.bag/l/image")}, "left"); };
  const std::vector<FrameImage> images = list();
  ASSERT_EQ(images.size(), 2U);
  EXPECT_EQ(images[0].frame, "0000000001000000000");
  ASSERT_EQ(lister.Notes().size(), 1U);
  EXPECT_THAT(lister.Notes()[0], HasSubstr("its times jump backwards 1 times"));
  std::filesystem::remove(Path("a.bag"));
  Write("a.bag", "");
  EXPECT_EQ(list().size(), 2U);
  // One that is open already.
  Write("b.bag", bag + "cut");
  ImageLister other;
  other.Use(std::make_shared<const MessageLog>(Path("b.bag")));
  ASSERT_EQ(other.Notes().size(), 1U);
  EXPECT_THAT(other.Notes()[0], HasSubstr("is cut off or damaged"));
  Write("b.bag", "");
  EXPECT_EQ(other.List({In("b.bag")}, "left").size(), 2U);
}

TEST_F(Stores, AndFilesAreTheInputsOfCommands) {
  Zip("a.zip", {{"l/1.png", ""}});
  Write("i/1.png", "");
  Write("i/2.png", "");
  const auto find = [&](std::vector<std::string> inputs) {
    for (std::string& input : inputs) input = In(input);
    return Shown(FindImageInputs(inputs, "white images"));
  };
  // One after the other; a frame may be in several.
  EXPECT_THAT(find({"i/2.png", "a.zip/l", "i/*.png"}),
              ElementsAre("2@i/2.png", "1@a.zip/l/1.png", "1@i/1.png", "2@i/2.png"));
  EXPECT_EQ(RefusalOf([&] {
              find({"i/2.png", "i/3.png"});
            }),
            In("i/3.png") + ": no such file; check the path");
  EXPECT_THAT(RefusalOf([&] { find({"i/*.jpg"}); }), StartsWith("white images: no file matches"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
