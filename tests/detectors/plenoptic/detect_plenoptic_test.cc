// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/detect_plenoptic.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

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

// A chessboard of 4 x 3 inner corners in the virtual image, white where `covered` is set in its
// first squares.
class DetectChessboard : public DetectPlenoptic {
 protected:
  static constexpr double kDepth = 3.5, kSquare = 36;

  DetectChessboard() { target_.layout = ChessboardLayout{{}, 4, 3, 0.03}; }

  [[nodiscard]] double Board(const Eigen::Vector2d& q, bool covered) const {
    const Eigen::Vector2d s = (q - Eigen::Vector2d(40, 28)) / kSquare;
    if (s.minCoeff() < 0 || s.x() >= 5 || s.y() >= 4) return 1;
    if (covered && s.maxCoeff() < 1.5) return 1;
    return (static_cast<int>(s.x()) + static_cast<int>(s.y())) % 2 == 0 ? 0.2 : 1;
  }
  FrameImage Save(const std::string& name, bool covered) const {
    constexpr int kSamples = 4;
    cv::Mat raw(field_.white.size(), CV_16U, cv::Scalar(0));
    for (int y = 0; y < raw.rows; ++y) {
      for (int x = 0; x < raw.cols; ++x) {
        const Eigen::Vector2d pixel(x, y);
        const TrueLens& lens = *std::ranges::min_element(
            field_.lenses, {}, [&](const TrueLens& each) { return (each.centre - pixel).norm(); });
        double sum = 0;
        for (int k = 0; k < kSamples * kSamples; ++k) {
          const Eigen::Vector2d sub((k % kSamples + 0.5) / kSamples - 0.5,
                                    (std::floor(k / kSamples) + 0.5) / kSamples - 0.5);
          sum += Board(lens.centre + kDepth * (pixel + sub - lens.centre), covered);
        }
        raw.at<std::uint16_t>(y, x) = cv::saturate_cast<std::uint16_t>(
            10 * field_.white.at<float>(y, x) * sum / (kSamples * kSamples));
      }
    }
    cv::imwrite(Path(name + ".png"), raw);
    return {name, Path(name + ".png")};
  }
};

TEST_F(DetectChessboard, KeepsThePictureWithMostMarkers) {
  const FrameImage all = Save("all", false), part = Save("part", true);
  DetectionCache cache(folder_ / "cache", "test", false);
  for (const bool cached : {false, true}) {
    if (cached) options_.cache = &cache;
    for (const std::vector<FrameImage>& images :
         {std::vector{all, part}, {part, all}, {part, all}}) {
      const ImageDetections found = DetectPlenopticImages(images, target_, options_);
      ASSERT_EQ(found.views.size(), 2U) << ::testing::PrintToString(found.left_out.size());
      EXPECT_EQ(found.sample.frame, "all");
      EXPECT_FALSE(found.sample.picture.empty());
      EXPECT_FALSE(found.sample.depth.empty());
      EXPECT_GT(found.views[images[0].frame == "all" ? 0 : 1].observations.size(), 40U);
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
