// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/stored/stored_pixels.h"

#include <gmock/gmock.h>

#include <cstdint>

#include "tests/refusal.h"

namespace plenocal::internal {
namespace TEST_FILE {

using ::testing::HasSubstr;

// Two rows of three pixels, each row with two bytes after it; byte k of a row is 10 row + k + 1.
StoredImage Pixels(const char* encoding, size_t row_bytes, bool big_endian) {
  StoredImage stored;
  stored.size = {3, 2};
  stored.encoding = encoding;
  stored.step = row_bytes + 2;
  stored.big_endian = big_endian;
  for (size_t row = 0; row < 2; ++row) {
    for (size_t k = 0; k < stored.step; ++k) {
      stored.bytes.push_back(static_cast<char>(k < row_bytes ? 10 * row + k + 1 : 255));
    }
  }
  return stored;
}

TEST(StoredPixels, OfEightBitsAreBytesWhateverTheirOrder) {
  for (const bool big_endian : {false, true}) {
    const cv::Mat image = ImageOfPixels(Pixels("mono8", 3, big_endian), "bag");
    ASSERT_EQ(image.type(), CV_8UC1);
    ASSERT_EQ(image.size(), cv::Size(3, 2));
    for (int y = 0; y < 2; ++y) {
      for (int x = 0; x < 3; ++x) EXPECT_EQ(image.at<uchar>(y, x), 10 * y + x + 1);
    }
  }
}

TEST(StoredPixels, OfSixteenBitsAreInTheirOrder) {
  for (const bool big_endian : {false, true}) {
    const cv::Mat image = ImageOfPixels(Pixels("mono16", 6, big_endian), "bag");
    ASSERT_EQ(image.type(), CV_16UC1);
    for (int y = 0; y < 2; ++y) {
      for (int x = 0; x < 3; ++x) {
        const int first = 10 * y + 2 * x + 1, second = first + 1;
        EXPECT_EQ(image.at<std::uint16_t>(y, x),
                  big_endian ? 256 * first + second : 256 * second + first);
      }
    }
  }
}

TEST(StoredPixels, OfColoursAreBlueGreenRed) {
  const cv::Mat bgr = ImageOfPixels(Pixels("bgr8", 9, false), "bag"),
                rgb = ImageOfPixels(Pixels("rgb8", 9, false), "bag");
  EXPECT_EQ(bgr.at<cv::Vec3b>(1, 2), cv::Vec3b(17, 18, 19));
  EXPECT_EQ(rgb.at<cv::Vec3b>(1, 2), cv::Vec3b(19, 18, 17));
  EXPECT_EQ(GrayOfPixels(Pixels("mono8", 3, false), "bag").at<uchar>(1, 1), 12);
}

TEST(StoredPixels, RefusesWhatDoesNotHoldThePixels) {
  const auto message = [](const StoredImage& stored) -> std::string {
    return testing::RefusalOf([&] { ImageOfPixels(stored, "bag"); });
  };
  StoredImage stored = Pixels("mono8", 3, false);
  stored.bytes.resize(stored.step + 3);  // the last row may end with its pixels
  EXPECT_EQ(message(stored), "no refusal");
  stored.bytes.pop_back();
  EXPECT_THAT(message(stored), HasSubstr("bag: "));
  EXPECT_THAT(message(stored), HasSubstr("do not fit into its 7 bytes"));
  stored = Pixels("mono8", 3, false);
  stored.step = 2;
  EXPECT_THAT(message(stored), HasSubstr("a step of 2 bytes"));
  EXPECT_THAT(message(Pixels("mono9", 3, false)), HasSubstr("mono9"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
