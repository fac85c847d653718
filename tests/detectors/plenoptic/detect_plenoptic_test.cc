// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/detect_plenoptic.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "calib/io/detection_cache.h"
#include "tests/detectors/plenoptic/plenoptic_scene.h"
#include "tests/detectors/plenoptic/white/white_field.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

/// Raw images of a texture without markers, under the white images of the same array.
class DetectPlenoptic : public InTemporaryFolder {
 protected:
  DetectPlenoptic() {
    target_.layout = ChessboardLayout{{}, 7, 5, 0.03};
    SaveWhite(1);
    SaveRaw(1);
    options_.white_images = {{"white", Path("white.png")}};
    options_.threads = 1;
  }
  void SaveWhite(double brightness) {
    cv::Mat white;
    field_.white.convertTo(white, CV_16U, 10 * brightness);
    cv::imwrite(Path("white.png"), white);
  }
  void SaveRaw(unsigned seed) {
    PlenopticScene scene{.width = 260, .height = 200, .pitch = 20, .seed = seed};
    MicroLensArray array;
    for (const TrueLens& lens : field_.lenses) array.lenses.push_back({.centre = lens.centre});
    cv::imwrite(Path("raw.png"), scene.Raw(array));
  }
  ImageDetections Detect() {
    DetectionCache cache(folder_ / "cache", "test", false);
    options_.cache = &cache;
    return DetectPlenopticImages({{"raw", Path("raw.png")}}, target_, options_);
  }

  const RenderedField field_ = Render({.size = {260, 200}, .types = 1});
  Target target_;
  DetectOptions options_;
};

// What is kept of an earlier run is that of the same raw image and the same white images.
TEST_F(DetectPlenoptic, ReusesNothingOfOtherImagesOrWhiteImages) {
  const ImageDetections first = Detect();
  EXPECT_EQ(first.reused, 0U);
  EXPECT_EQ(first.image_size, (ImageSize{260, 200}));
  ASSERT_EQ(first.left_out.size(), 1U);
  EXPECT_THAT(first.left_out[0].reason, ::testing::StartsWith("no 7 x 5 chessboard found"));
  const ImageDetections again = Detect();
  EXPECT_EQ(again.reused, 1U);
  EXPECT_EQ(again.vignetting, first.vignetting);
  EXPECT_EQ(again.micro_lenses, first.micro_lenses);
  SaveRaw(2);
  EXPECT_EQ(Detect().reused, 0U);
  SaveWhite(0.5);
  const ImageDetections darker = Detect();
  EXPECT_EQ(darker.reused, 0U);
  EXPECT_NE(darker.vignetting, first.vignetting);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
