// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/white_camera.h"

#include <gmock/gmock.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <random>
#include <string>
#include <vector>

#include "calib/files/raytrix_grid.h"
#include "tests/detectors/plenoptic/white/white_field.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::RefusalOf;
using ::testing::SizeIs;
using ::testing::StartsWith;
using testing::WhiteField;

constexpr int kImages = 3;

class WhiteCameraTest : public testing::InTemporaryFolder {
 protected:
  // White images of a field, and the micro lenses of its array.
  MicroLensArray Save(WhiteField field) {
    MicroLensArray array;
    array.image_size = field.size;
    images_.clear();
    for (unsigned seed = 1; seed <= kImages; ++seed) {
      field.seed = seed;
      const testing::RenderedField rendered = testing::Render(field);
      cv::Mat white;
      rendered.white.convertTo(white, CV_16U, 10);
      const std::string name = "white" + std::to_string(seed) + ".png";
      cv::imwrite(Path(name).string(), white);
      images_.push_back({name, Path(name)});
      array.lenses.clear();
      for (const testing::TrueLens& lens : rendered.lenses) {
        array.lenses.push_back(
            {.row = lens.node.row, .column = lens.node.column, .centre = lens.centre});
      }
    }
    return array;
  }
  [[nodiscard]] WhiteCamera Measure(const WhiteOptions& options) const {
    return MeasureWhiteImages(images_, options);
  }

  std::vector<FrameImage> images_;
};

TEST_F(WhiteCameraTest, HasItsGridAndTheFiguresOfItsImages) {
  const MicroLensArray array = Save({.size = {320, 240}, .types = 1});
  const WhiteCamera camera = Measure({.plenoptic = true, .threads = 1, .measure_noise = true});
  EXPECT_EQ(camera.image_size, (ImageSize{320, 240}));
  EXPECT_EQ(camera.images, kImages);
  EXPECT_THAT(camera.left_out, IsEmpty());
  EXPECT_THAT(camera.warnings, IsEmpty());
  ASSERT_TRUE(camera.grid);
  EXPECT_THAT(camera.grid->array.lenses, SizeIs(array.lenses.size()));
  EXPECT_TRUE(camera.noise);
  EXPECT_GT(camera.darkest, 0);
  EXPECT_LT(camera.darkest, 0.2);
  EXPECT_FALSE(camera.grid_png.empty());
  EXPECT_FALSE(camera.attenuation_tiff.empty());
  EXPECT_FALSE(Measure({.plenoptic = true}).noise);
}

TEST_F(WhiteCameraTest, OfFewMicroImagesHasAssumedErrors) {
  Save({.size = {170, 130}, .types = 1});
  const WhiteCamera camera = Measure({.plenoptic = true});
  ASSERT_THAT(camera.warnings, SizeIs(1));
  EXPECT_THAT(camera.warnings[0],
              StartsWith("fewer than 60 whole micro images do not show the errors"));
}

TEST_F(WhiteCameraTest, NamesRawMosaicsThatAreNotStatedAndColoursThatAreNotThere) {
  Save({.size = {320, 240}, .types = 1, .bayer = true});
  EXPECT_THAT(RefusalOf([&] { (void)Measure({.plenoptic = true}); }, ErrorKind::kJob),
              AllOf(HasSubstr("no hexagonal or rectangular lattice of micro images"),
                    HasSubstr("; the white images look like raw colour mosaics")));
  EXPECT_THAT(Measure({.plenoptic = true, .bayer = BayerOrder::kRggb}).warnings, IsEmpty());
  EXPECT_THAT(RefusalOf([&] { (void)Measure({.plenoptic = true, .bayer = BayerOrder::kGrbg}); }),
              AllOf(StartsWith("bayer: GRBG: its green pixels differ by "),
                    HasSubstr("; the order is RGGB or BGGR")));
  Save({.size = {320, 240}, .types = 1});
  const WhiteCamera grey = Measure({.plenoptic = true, .bayer = BayerOrder::kRggb});
  ASSERT_THAT(grey.warnings, SizeIs(1));
  EXPECT_THAT(grey.warnings[0],
              StartsWith("bayer: RGGB: the planes of the 2 x 2 raster are alike"));
}

// One in six is dead.
TEST_F(WhiteCameraTest, IsRefusedWhereManyMicroImagesAreUnlikeTheOthers) {
  WhiteField dirty{.size = {320, 240}, .types = 1};
  std::mt19937 random(1);
  for (int row = -10; row <= 10; ++row) {
    for (int column = -20; column <= 20; ++column) {
      if (random() % 6 == 0) dirty.dead.insert({column, row});
    }
  }
  const MicroLensArray array = Save(dirty);
  const auto refused = [&](const WhiteOptions& options) {
    return RefusalOf([&] { (void)Measure(options); }, ErrorKind::kJob);
  };
  EXPECT_THAT(refused({.plenoptic = true}),
              AllOf(HasSubstr("micro images do not look like the others: "),
                    HasSubstr("record an even white field")));
  Write("grid.xml", RayCalibDataXml(array));
  EXPECT_THAT(refused({.plenoptic = true, .grid_file = Path("grid.xml")}),
              HasSubstr("does the grid belong to these images?"));
}

TEST_F(WhiteCameraTest, HasTheSizeOfItsRawImages) {
  Save({.size = {320, 240}, .types = 1});
  cv::imwrite(Path("raw.png").string(), cv::Mat(240, 300, CV_8U, cv::Scalar(9)));
  EXPECT_THAT(RefusalOf([&] { (void)Measure({.plenoptic = true, .raw_image = Path("raw.png")}); }),
              HasSubstr("raw.png: is 300 x 240 pixels, but the white images are 320 x 240"));
}

TEST_F(WhiteCameraTest, OfAnOrdinaryCameraHasNoGrid) {
  for (int i = 1; i <= 2; ++i) {
    const std::string name = "even" + std::to_string(i) + ".png";
    cv::imwrite(Path(name).string(), cv::Mat(120, 160, CV_8U, cv::Scalar(150)));
    images_.push_back({name, Path(name)});
  }
  const WhiteCamera camera = Measure({});
  EXPECT_FALSE(camera.grid);
  EXPECT_TRUE(camera.grid_png.empty());
  EXPECT_FALSE(camera.attenuation_tiff.empty());
  EXPECT_NEAR(camera.darkest, 1, 0.01);
  // White images of micro lenses are no even field.
  Save({.size = {320, 240}, .types = 1});
  EXPECT_NE(RefusalOf([&] { (void)Measure({}); }, ErrorKind::kJob), "no refusal");
}

}  // namespace TEST_FILE
}  // namespace plenocal
