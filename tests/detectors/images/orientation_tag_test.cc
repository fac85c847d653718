// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/orientation_tag.h"

#include <gtest/gtest.h>

#include <string>
#include <string_view>

namespace plenocal::internal {
namespace TEST_FILE {

using namespace std::string_literals;

int TagOf(std::string_view content) {
  return OrientationTag({reinterpret_cast<const std::uint8_t*>(content.data()), content.size()});
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
  const std::string jfif = Segment('\xe0', "JFIF\0\1\1\0\0\1\0\1\0\0"s);
  const std::string xmp = Segment('\xe1', "http://ns.adobe.com/xap/1.0/\0<x/>"s);
  return "\xff\xd8" + jfif + xmp + Segment('\xe1', "Exif\0\0"s + tiff) + Segment('\xda', "scan");
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
  // What follows the scan's header is image data.
  EXPECT_EQ(TagOf("\xff\xd8" + Segment('\xda', "scan") + Segment('\xe1', "Exif\0\0"s + kLittle)),
            1);
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
}  // namespace plenocal::internal
