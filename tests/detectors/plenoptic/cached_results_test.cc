// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/cached_results.h"

#include <gmock/gmock.h>

namespace plenocal {
namespace TEST_FILE {

internal::MicroLensCalibration Example() {
  internal::MicroLensCalibration camera;
  camera.array.image_size = {3, 2};
  camera.array.types = 2;
  camera.array.e_column = {5, 0.5};
  camera.array.lenses = {{.row = 1, .column = -2, .centre = {0.25, 1}, .type = 1, .usable = false},
                         {.row = 1, .column = -1, .centre = {2, 1}}};
  camera.attenuation = {0.5f, 1, 0.75f, 1, 1, 0.25f};
  camera.grid_png = "a picture";
  camera.left_out = {{.where = "white.png", .reason = "is black"}};
  return camera;
}

TEST(CachedResults, ComeBackAsTheyWere) {
  const auto back = internal::UnpackMicroLenses(PackEntry(Example()));
  ASSERT_TRUE(back);
  EXPECT_EQ(back->array.e_column, Eigen::Vector2d(5, 0.5));
  ASSERT_EQ(back->array.lenses.size(), 2U);
  EXPECT_EQ(back->array.lenses[0].column, -2);
  EXPECT_EQ(back->array.lenses[0].centre, Eigen::Vector2d(0.25, 1));
  EXPECT_FALSE(back->array.lenses[0].usable);
  EXPECT_TRUE(back->array.lenses[1].usable);
  EXPECT_EQ(back->attenuation, Example().attenuation);
  EXPECT_EQ(back->grid_png, "a picture");
  ASSERT_EQ(back->left_out.size(), 1U);
  EXPECT_EQ(back->left_out[0].reason, "is black");
}

TEST(CachedResults, AreNothingWhereBytesAreMissingOrLeft) {
  const std::string bytes = PackEntry(Example());
  for (size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_FALSE(internal::UnpackMicroLenses(bytes.substr(0, size))) << size;
  }
  EXPECT_FALSE(internal::UnpackMicroLenses(bytes + 'x'));
  // A length that no memory has.
  EXPECT_FALSE(UnpackEntry<internal::Pictures>(std::string(8, '\x7f')));
}

TEST(CachedResults, AreNothingWhereTheyDoNotFitTogether) {
  internal::MicroLensCalibration camera = Example();
  camera.attenuation.pop_back();
  EXPECT_FALSE(internal::UnpackMicroLenses(PackEntry(camera)));
  camera = Example();
  camera.array.lenses[1].type = 2;
  EXPECT_FALSE(internal::UnpackMicroLenses(PackEntry(camera)));
}

}  // namespace TEST_FILE
}  // namespace plenocal
