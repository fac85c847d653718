// SPDX-License-Identifier: Apache-2.0
#include "engine/resample/point_cloud.h"

#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <string>

namespace plenocal {
namespace TEST_FILE {

TEST(PlyText, HasTheBytesOfItsHeader) {
  const std::array<CloudPoint, 2> points{CloudPoint{{1, -2.5F, 3}, 0.25F, {1, 128, 255}},
                                         CloudPoint{{0.1F, 0, 1e6F}, 7, {9, 8, 7}}};
  const std::string text = PlyText(points, "one line");
  const std::string header =
      "ply\nformat binary_little_endian 1.0\ncomment one line\nelement vertex 2\n"
      "property float x\nproperty float y\nproperty float z\nproperty float sigma\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
  ASSERT_EQ(text.substr(0, header.size()), header);
  constexpr size_t kBytes = 4 * sizeof(float) + 3;
  ASSERT_EQ(text.size(), header.size() + 2 * kBytes);
  for (size_t i = 0; i < 2; ++i) {
    const char* const bytes = text.data() + header.size() + i * kBytes;
    std::array<float, 4> numbers;  // of a machine that stores the lowest byte first
    std::memcpy(numbers.data(), bytes, sizeof numbers);
    for (size_t k = 0; k < 3; ++k) {
      EXPECT_EQ(numbers[k], points[i].p[k]);
      EXPECT_EQ(static_cast<std::uint8_t>(bytes[sizeof numbers + k]), points[i].rgb[k]);
    }
    EXPECT_EQ(numbers[3], points[i].sigma);
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
