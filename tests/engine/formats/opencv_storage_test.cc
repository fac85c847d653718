// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/opencv_storage.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <string>
#include <vector>

#include "calib/base/error.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class OpenCvStorage : public testing::InTemporaryFolder {};

TEST_F(OpenCvStorage, IsReadWithAndWithoutItsFirstLine) {
  const std::string keys = "width: 640\nheight: 480\n";
  for (const std::string& head : {std::string(kOpenCvHead),
                                  std::string("%YAML:1.0\n"),
                                  std::string("---\n"),
                                  std::string()}) {
    const YamlNode root = ReadStorage(Write("camera.yml", head + keys));
    EXPECT_EQ(root.At("width").AsInteger(), 640) << head;
    EXPECT_EQ(root.At("height").AsInteger(), 480) << head;
  }
  // Places in messages are those of the file.
  const YamlNode root =
      ReadStorage(Write("camera.yml", std::string(kOpenCvHead) + "width: many\n"));
  EXPECT_THAT(testing::RefusalOf([&] { (void)root.At("width").AsInteger(); }),
              HasSubstr("camera.yml:3:"));
}

TEST_F(OpenCvStorage, HoldsMatricesAndLists) {
  const std::array numbers{1.5, -2.0, 3e-7, 4.0, 5.0, 6.0};
  const std::string text = std::string(kOpenCvHead) + OpenCvMatrix("opencv", 2, 3, 'd', numbers) +
                           "list: [1.5, -2, 3e-7, 4, 5, 6]\n"
                           "rows: [[1.5, -2, 3e-7], [4, 5, 6]]\n";
  EXPECT_THAT(text, HasSubstr("rows: 2"));
  EXPECT_THAT(text, HasSubstr("cols: 3"));
  EXPECT_THAT(text, HasSubstr("dt: d"));
  const YamlNode root = ReadStorage(Write("camera.yml", text));
  for (const char* key : {"opencv", "list", "rows"}) {
    for (const size_t count : {size_t{0}, numbers.size()}) {
      EXPECT_THAT(MatrixData(root.At(key), count), ElementsAre(1.5, -2, 3e-7, 4, 5, 6)) << key;
    }
    EXPECT_THROW(MatrixData(root.At(key), 5), Error) << key;
  }
}

TEST_F(OpenCvStorage, HoldsALens) {
  const Lens lens{"radtan", 500, 510, 320, 240, {-0.1, 0.02, 1e-3, 2e-3}};
  const YamlNode root = ReadStorage(Write(
      "camera.yml", std::string(kOpenCvHead) + CameraMatrix("K", lens) + Coefficients("D", lens)));
  const Lens again = LensOf(root.At("K"), root.At("D"), OpenCvDistortion::kRadtan);
  EXPECT_EQ(again.name, "radtan");
  EXPECT_EQ(again.f_x, 500);
  EXPECT_EQ(again.f_y, 510);
  EXPECT_EQ(again.c_x, 320);
  EXPECT_EQ(again.c_y, 240);
  EXPECT_EQ(again.coefficients, lens.coefficients);
  const Lens fisheye = LensOf(root.At("K"), std::nullopt, OpenCvDistortion::kFisheye);
  EXPECT_EQ(fisheye.name, "fisheye");
  EXPECT_TRUE(fisheye.coefficients.empty());
  const YamlNode skewed =
      ReadStorage(Write("camera.yml", "K: [500, 1, 320, 0, 510, 240, 0, 0, 1]\n"));
  EXPECT_THROW(LensOf(skewed.At("K"), std::nullopt, OpenCvDistortion::kRadtan), Error);
}

}  // namespace TEST_FILE
}  // namespace plenocal
