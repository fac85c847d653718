// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/image_header.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

namespace plenocal {
namespace TEST_FILE {

constexpr ImageSize kSize{64, 48};

std::vector<std::uint8_t> EncodedAs(const std::string& extension) {
  std::vector<std::uint8_t> bytes;
  cv::imencode(extension, cv::Mat(kSize[1], kSize[0], CV_8U, cv::Scalar(7)), bytes);
  return bytes;
}

TEST(ImageHeader, HasTheSizeOfEachFormat) {
  for (const char* extension : {".png", ".jpg", ".bmp", ".pgm", ".tiff"}) {
    EXPECT_EQ(SizeInHeader(EncodedAs(extension)), kSize) << extension;
  }
}

TEST(ImageHeader, SufficesForMostFormats) {
  constexpr std::size_t kLong = 700;  // a JPEG has its tables before the size
  for (const char* extension : {".png", ".jpg", ".bmp", ".pgm"}) {
    std::vector<std::uint8_t> start = EncodedAs(extension);
    start.resize(std::min(start.size(), kLong));
    EXPECT_EQ(SizeInHeader(start), kSize) << extension;
  }
}

TEST(ImageHeader, OfOtherOrDamagedContentHasNone) {
  const std::string words = "P5 of words";
  EXPECT_FALSE(SizeInHeader({}));
  EXPECT_FALSE(SizeInHeader({reinterpret_cast<const std::uint8_t*>(words.data()), words.size()}));
  for (const char* extension : {".png", ".jpg", ".bmp", ".pgm", ".tiff"}) {
    const std::vector<std::uint8_t> whole = EncodedAs(extension);
    for (std::size_t length = 0; length < 200 && length < whole.size(); ++length) {
      const auto size = SizeInHeader(std::span(whole).first(length));
      // The size stands in the file before its end, or cannot be read yet.
      EXPECT_TRUE(!size || *size == kSize || std::string(extension) == ".pgm") << extension;
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
