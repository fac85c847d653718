// SPDX-License-Identifier: Apache-2.0
#include "engine/resample/stereo_pairs.h"

#include <gmock/gmock.h>

#include <opencv2/core.hpp>

#include "detectors/images/image.h"
#include "detectors/images/image_codecs.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::vector<FrameImage> Images(const std::string& folder, const std::vector<std::string>& frames) {
  std::vector<FrameImage> images;
  for (const std::string& frame : frames) {
    images.push_back({.frame = frame, .path = folder + "/" + frame + ".png"});
  }
  return images;
}

std::vector<std::string> Names(const std::vector<FrameImage>& images) {
  std::vector<std::string> names;
  for (const FrameImage& image : images) names.push_back(image.path.stem().string());
  return names;
}

std::string Message(const StereoImages& images) {
  return testing::RefusalOf([&] { PairImages(images); });
}

TEST(PairImages, PairsEqualFramesAndNamesTheOthers) {
  const StereoPairs pairs =
      PairImages({Images("left", {"b", "a", "c"}), Images("right", {"a", "d", "b"})});
  EXPECT_THAT(Names(pairs.images[0]), ElementsAre("a", "b"));
  EXPECT_THAT(Names(pairs.images[1]), ElementsAre("a", "b"));
  EXPECT_FALSE(pairs.by_number);
  ASSERT_EQ(pairs.left_out.size(), 2);
  EXPECT_EQ(pairs.left_out[0].where, "left/c.png");
  EXPECT_EQ(pairs.left_out[0].reason, "the other camera has no image of frame 'c'");
  EXPECT_EQ(pairs.left_out[1].where, "right/d.png");
  EXPECT_EQ(pairs.left_out[1].reason, "the other camera has no image of frame 'd'");
}

TEST(PairImages, PairsByTheLastNumberWhereNoFrameIsEqual) {
  const StereoPairs pairs = PairImages(
      {Images("l", {"1left01", "1left02", "1left10"}), Images("r", {"right02x", "right01x"})});
  EXPECT_TRUE(pairs.by_number);
  EXPECT_THAT(Names(pairs.images[0]), ElementsAre("1left01", "1left02"));
  EXPECT_THAT(Names(pairs.images[1]), ElementsAre("right01x", "right02x"));
  EXPECT_EQ(pairs.images[0][1].frame, "02");
  ASSERT_EQ(pairs.left_out.size(), 1);
  EXPECT_THAT(pairs.left_out[0].reason, HasSubstr("frame '10'"));
}

TEST(PairImages, AreNotPairedByNumbersThatAreMissingOrTwice) {
  const char* const words = "no image of one camera belongs to one of the other";
  EXPECT_THAT(Message({Images("l", {"a1", "b1"}), Images("r", {"c1", "c2"})}), HasSubstr(words));
  EXPECT_THAT(Message({Images("l", {"a1", "b2"}), Images("r", {"c1", "c"})}), HasSubstr(words));
  EXPECT_THAT(Message({Images("l", {"a1", "b2"}), Images("r", {"c3", "c4"})}),
              HasSubstr("(l/a1.png is frame 'a1', r/c3.png is 'c3')"));
}

TEST(PairImages, OfOneImageEachAreAPair) {
  const StereoPairs pairs = PairImages({Images("l", {"here"}), Images("r", {"there"})});
  EXPECT_THAT(Names(pairs.images[0]), ElementsAre("here"));
  EXPECT_THAT(Names(pairs.images[1]), ElementsAre("there"));
  EXPECT_THAT(pairs.left_out, IsEmpty());
}

TEST(PairImages, RefusesOneFileAsBoth) {
  const std::string file = "/proc/self/exe";
  const std::vector<FrameImage> one{{.frame = "a", .path = file}};
  EXPECT_THAT(Message({one, one}), HasSubstr("are one file"));
  std::vector<FrameImage> two = one;
  two.push_back({.frame = "b", .path = "other.png"});
  EXPECT_THAT(Message({two, two}), HasSubstr("are one file"));
}

TEST(DrawPair, HasBothImagesSideBySideWithTwentyLines) {
  // Of 16 bits and grey; of 8 bits and in colour.
  const std::string png =
      DrawPair(EncodeImage(".png", cv::Mat(200, 50, CV_16U, cv::Scalar(257 * 90))),
               EncodeImage(".png", cv::Mat(200, 50, CV_8UC3, cv::Scalar(10, 20, 30))));
  const cv::Mat both =
      DecodeImage(std::vector<std::uint8_t>(png.begin(), png.end()), Channels::kAsStored);
  ASSERT_EQ(both.type(), CV_8UC3);
  ASSERT_EQ(both.size(), cv::Size(100, 200));
  for (int y = 0; y < 200; ++y) {
    const cv::Vec3b left = both.at<cv::Vec3b>(y, 0), right = both.at<cv::Vec3b>(y, 99);
    if (y % 10 == 5) {
      const cv::Vec3b line = y % 20 == 5 ? cv::Vec3b(60, 220, 60) : cv::Vec3b(60, 160, 255);
      EXPECT_EQ(left, line) << y;
      EXPECT_EQ(right, line) << y;
    } else {
      EXPECT_EQ(left, cv::Vec3b(90, 90, 90)) << y;
      EXPECT_EQ(right, cv::Vec3b(10, 20, 30)) << y;
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
