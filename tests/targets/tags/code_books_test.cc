// SPDX-License-Identifier: Apache-2.0
//
// The codes that target files may name, against the libraries that have them.
#include "targets/code_books.h"

#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>
#include <apriltag/tagCircle21h7.h>
#include <apriltag/tagStandard41h12.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <memory>

#include "targets/tags/tag_family.h"
#include "targets/types/charuco.h"
#include "tests/targets/aruco_cells.h"

namespace plenocal::internal {
namespace TEST_FILE {

// The library does not export its own function.
void Free(image_u8_t* image) {
  std::free(image->buf);
  std::free(image);
}

TEST(CodeBooks, HaveAsManyTagsAsTheLibrary) {
  for (const CodeBook& book : kTagFamilies) {
    EXPECT_EQ(TagFamily(book.name, 1).size(), book.size) << book.name;
  }
}

TEST(CodeBooks, HaveAsManyMarkersAsOpenCv) {
  for (const CodeBook& book : kArucoDictionaries) {
    const auto dictionary = testing::ArucoDictionary(ArucoDictionaryIndex(std::string(book.name)));
    EXPECT_EQ(dictionary->bytesList.rows, book.size) << book.name;
  }
}

TEST(TagFamily, DrawsTagsAsTheLibrary) {
  struct Family {
    apriltag_family_t* (*create)();
    void (*destroy)(apriltag_family_t*);
  };
  for (const Family& functions : {Family{tag36h11_create, tag36h11_destroy},
                                  Family{tagStandard41h12_create, tagStandard41h12_destroy},
                                  Family{tagCircle21h7_create, tagCircle21h7_destroy}}) {
    const std::unique_ptr<apriltag_family_t, void (*)(apriltag_family_t*)> library(
        functions.create(), functions.destroy);
    for (const int id : {0, 17}) {
      const std::unique_ptr<image_u8_t, void (*)(image_u8_t*)> image(
          apriltag_to_image(library.get(), static_cast<std::uint32_t>(id)), Free);
      const TagPicture picture = TagFamily(library->name, 1).Picture(id);
      ASSERT_EQ(picture.width, image->width) << library->name;
      EXPECT_EQ(picture.width - 2 * picture.margin, library->width_at_border);
      for (int y = 0; y < picture.width; ++y) {
        for (int x = 0; x < picture.width; ++x) {
          EXPECT_EQ(picture.white[static_cast<size_t>(y * picture.width + x)],
                    image->buf[y * image->stride + x] != 0)
              << library->name << " " << id << " at " << x << ", " << y;
        }
      }
    }
  }
}

TEST(TagFamily, PutsAWiderBorderAroundTheSameBits) {
  const TagFamily narrow("tag36h11", 1), wide("tag36h11", 2);
  ASSERT_EQ(wide.width_at_border(), narrow.width_at_border() + 2);
  const int n = narrow.width_at_border();
  const std::vector<bool> inner = narrow.Bits(3), outer = wide.Bits(3);
  for (int y = 0; y < n + 2; ++y) {
    for (int x = 0; x < n + 2; ++x) {
      const bool border = x == 0 || y == 0 || x == n + 1 || y == n + 1;
      const bool expected = !border && inner[static_cast<size_t>((y - 1) * n + x - 1)];
      EXPECT_EQ(outer[static_cast<size_t>(y * (n + 2) + x)], expected) << x << ", " << y;
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
