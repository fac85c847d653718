// SPDX-License-Identifier: Apache-2.0
//
// Frames of the video in tests/data/recordings: six grey images of 16 x 12 px, ten a second.
#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>

#include "engine/recording/stores/image_lister.h"
#include "engine/recording/video/video_store.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::IsEmpty;

class Videos : public InTemporaryFolder {
 protected:
  /// The grey value of a frame, which is the same in all pixels and colours.
  static int GreyOf(const StoredImage& image) {
    EXPECT_EQ(image.encoding, "bgr8");
    EXPECT_EQ(image.size, (ImageSize{16, 12}));
    EXPECT_EQ(image.step, 48U);
    EXPECT_EQ(image.bytes.size(), 48U * 12);
    const auto [least, most] = std::ranges::minmax(image.bytes);
    EXPECT_LE(most - least, 4);
    return (least + most) / 2;
  }
  const std::filesystem::path video_ =
      std::filesystem::path(PLENOCAL_TEST_DATA) / "recordings" / "left.avi";
};

TEST_F(Videos, HaveFramesInAnyOrder) {
  const VideoStore store(video_);
  EXPECT_EQ(store.Count(), 6U);
  EXPECT_FALSE(store.HasFiles());
  EXPECT_THAT(store.Notes(), IsEmpty());
  ASSERT_EQ(store.Times().size(), 6U);
  for (size_t i = 1; i < 6; ++i) EXPECT_NEAR(store.Times()[i] - store.Times()[0], 0.1 * i, 1e-3);
  for (const size_t i : {0U, 3U, 2U, 5U, 1U}) {
    EXPECT_NEAR(GreyOf(store.Read(i)), 10 * static_cast<int>(i) + 5, 3) << i;
  }
  EXPECT_EQ(RefusalOf([&] { static_cast<void>(store.Read(6)); }),
            video_.string() + ": frame 6 cannot be decoded");
}

TEST_F(Videos, HaveSizeAndHashWithoutTheirPixels) {
  const std::vector<FrameImage> images = ListImages({video_.string()}, "left");
  ASSERT_EQ(images.size(), 6U);
  EXPECT_EQ(images[5].frame, "000005");
  EXPECT_EQ(images[5].path, video_ / "000005");
  EXPECT_EQ(images[5].index, 5U);
  EXPECT_NEAR(*images[5].time - *images[0].time, 0.5, 1e-3);
  const ImageStore& store = *images[0].store;
  EXPECT_EQ(store.Start(3, 100).size, (ImageSize{16, 12}));
  EXPECT_EQ(store.Start(3, 100).encoding, "bgr8");
  EXPECT_TRUE(store.Hash(3).ends_with(" 3"));
  EXPECT_NE(store.Hash(3), store.Hash(4));
}

TEST_F(Videos, ThatAreNoneAreRefused) {
  EXPECT_EQ(
      RefusalOf([&] { VideoStore store(Write("no.avi", "not at all")); }),
      Path("no.avi").string() +
          ": is no video that FFmpeg can open: damaged, cut off (an MP4 without its end has no "
          "index), or its codec is missing; copy it again, or extract the frames: ffmpeg -i "
          "VIDEO frames/%06d.png");
}

TEST(VideoNames, AreKnownByTheirExtensions) {
  for (const char* name : {"a.mp4",
                           "a.m4v",
                           "a.avi",
                           "a.mkv",
                           "a.mov",
                           "a.webm",
                           "a.mpg",
                           "a.mpeg",
                           "a.ts",
                           "a.wmv",
                           "d/A.MP4"}) {
    EXPECT_TRUE(IsVideoName(name)) << name;
  }
  for (const char* name : {"a.png", "avi", "a.avi.zip", ""})
    EXPECT_FALSE(IsVideoName(name)) << name;
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
