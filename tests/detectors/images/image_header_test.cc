// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/image_header.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <string_view>
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

using namespace std::string_literals;

int TagOf(std::string_view content) {
  return OrientationInHeader(
      {reinterpret_cast<const std::uint8_t*>(content.data()), content.size()});
}

std::string Segment(char type, const std::string& content) {
  const std::size_t length = content.size() + 2;
  return "\xff"s + type + static_cast<char>(length >> 8) + static_cast<char>(length) + content;
}

// A directory with the camera's maker before the orientation.
const std::string kLittle =
    "II*\0\x08\0\0\0\x02\0"
    "\x0f\x01\x02\0\x04\0\0\0Abc\0"
    "\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0"s;
const std::string kBig =
    "MM\0*\0\0\0\x08\0\x02"
    "\x01\x0f\0\x02\0\0\0\x04"
    "Abc\0\x01\x12\0\x03\0\0\0\x01\0\x03\0\0\0\0\0\0"s;

std::string Jpeg(const std::string& tiff) {
  const std::vector<std::uint8_t> image = EncodedAs(".jpg");
  const std::string xmp = Segment('\xe1', "http://ns.adobe.com/xap/1.0/\0<x/>"s);
  return "\xff\xd8" + xmp + Segment('\xe1', "Exif\0\0"s + tiff) +
         std::string(image.begin() + 2, image.end());
}

TEST(OrientationTag, IsReadInBothByteOrders) {
  EXPECT_EQ(TagOf(Jpeg(kLittle)), 6);
  EXPECT_EQ(TagOf(Jpeg(kBig)), 3);
}

TEST(OrientationTag, IsOneWhereThereIsNone) {
  EXPECT_EQ(TagOf(""), 1);
  EXPECT_EQ(TagOf("\x89PNG\r\n\x1a\n"), 1);
  EXPECT_EQ(TagOf("\xff\xd8" + Segment('\xda', "scan")), 1);
  EXPECT_EQ(TagOf(Jpeg("")), 1);
}

TEST(OrientationTag, IsNotReadBeyondTheFile) {
  for (const std::string& tiff : {kLittle, kBig}) {
    const std::string whole = Jpeg(tiff);
    // On the heap, so that the address sanitizer sees the end.
    for (std::size_t size = 0; size < whole.size(); ++size) TagOf(whole.substr(0, size));
    for (std::size_t size = 0; size < tiff.size(); ++size) {
      EXPECT_EQ(TagOf(Jpeg(tiff.substr(0, size))), size < tiff.size() - 4 ? 1 : TagOf(whole));
    }
    for (std::size_t at = 4; at < 10; ++at) {  // place and length of the directory
      std::string wrong = tiff;
      wrong[at] = '\xff';
      TagOf(Jpeg(wrong));
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
