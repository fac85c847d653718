// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/detect_plenoptic.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <opencv2/imgcodecs.hpp>
#include <random>
#include <string>
#include <vector>

#include "calib/io/detection_cache.h"
#include "targets/target.h"
#include "targets/target_drawing.h"
#include "tests/detectors/plenoptic/plenoptic_scene.h"
#include "tests/detectors/plenoptic/white/white_field.h"
#include "tests/digest.h"
#include "tests/targets/pattern.h"
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

  /// Saves the raw image of a plane of the virtual image, kDepth behind the micro lenses, where
  /// `brightness` (of q, px) is at most 1. `noise`: its standard deviation, of 10 times the white
  /// image.
  FrameImage SavePlane(const std::string& name,
                       const std::function<double(const Eigen::Vector2d&)>& brightness,
                       double noise) const {
    std::mt19937 random(3);
    std::normal_distribution<double> normal;
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
          sum += brightness(lens.centre + kDepth * (pixel + sub - lens.centre));
        }
        raw.at<std::uint16_t>(y, x) = cv::saturate_cast<std::uint16_t>(
            10 * field_.white.at<float>(y, x) * sum / (kSamples * kSamples) +
            noise * normal(random));
      }
    }
    cv::imwrite(Path(name + ".png"), raw);
    return {name, Path(name + ".png")};
  }

  static constexpr double kDepth = 3.5;
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
  static constexpr double kSquare = 36;

  DetectChessboard() { target_.layout = ChessboardLayout{{}, 4, 3, 0.03}; }

  [[nodiscard]] double Board(const Eigen::Vector2d& q, bool covered) const {
    const Eigen::Vector2d s = (q - Eigen::Vector2d(40, 28)) / kSquare;
    if (s.minCoeff() < 0 || s.x() >= 5 || s.y() >= 4) return 1;
    if (covered && s.maxCoeff() < 1.5) return 1;
    return (static_cast<int>(s.x()) + static_cast<int>(s.y())) % 2 == 0 ? 0.2 : 1;
  }
  FrameImage Save(const std::string& name, bool covered, double noise = 0) const {
    return SavePlane(
        name, [&](const Eigen::Vector2d& q) { return Board(q, covered); }, noise);
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

// Of all numbers together. Other instructions and compilers start the measurements elsewhere, which
// moves those of large sigmas by a hundredth of a pixel.
constexpr double kTolerance = 0.4;

double DigestOf(const ImageDetections& found) {
  Digest digest;
  for (const View& view : found.views) {
    for (size_t i = 0; i < view.observations.size(); ++i) {
      const Observation& each = view.observations[i];
      digest.Add(each.marker + 100 * each.lens_type);
      digest.AddAll(each.values);
      digest.Add(10 * each.detector_sigma);
      if (!view.by_nuisance.empty()) digest.AddAll(view.by_nuisance[i]);
    }
  }
  for (const BlurMeasurement& each : found.blur) {
    digest.AddAll(std::array{each.inverse_depth, each.blur, each.sigma});
    digest.AddAll(each.place);
  }
  for (const double covariance : found.lattice_errors.covariance) digest.Add(1e3 * covariance);
  return digest.Sum();
}

TEST_F(DetectChessboard, ResultsAreTheSameAsBefore) {
  const std::vector<FrameImage> images{Save("all", false, 500), Save("part", true, 1500)};
  EXPECT_NEAR(DigestOf(DetectPlenopticImages(images, target_, options_)), -96.032, kTolerance);
}

// Tags whose cells are 3 px wide in the micro images, and circles.
TEST_F(DetectPlenoptic, ResultsOnTagsAndCirclesAreTheSameAsBefore) {
  constexpr double kPerMetre = 2000;  // px of the virtual image
  const std::vector<std::pair<std::string, double>> targets{
      {"aprilgrid:2x2:30mm:0.3:tag16h5:border_bits=1", -30.88}, {"circles:5x4:18mm", -183.185}};
  for (const auto& [word, expected] : targets) {
    const Target target = TargetOfWord(word);
    const TargetPart part = DrawTarget(target).at(0);
    const FrameImage image = SavePlane(
        "printed",
        [&](const Eigen::Vector2d& q) {
          const Eigen::Vector2d at =
              part.paper.center() + (q - Eigen::Vector2d(128, 102)) / kPerMetre;
          return IsBlack(part, at) ? 0.2 : 1.0;
        },
        300);
    const ImageDetections found = DetectPlenopticImages({image}, target, options_);
    ASSERT_EQ(found.views.size(), 1U) << found.left_out.at(0).reason;
    EXPECT_NEAR(DigestOf(found), expected, kTolerance) << found.views[0].observations.size();
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
