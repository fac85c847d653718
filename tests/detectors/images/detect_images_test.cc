// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/detect_images.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "detectors/types/marker_detectors.h"
#include "tests/detectors/render_pattern.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::SizeIs;

constexpr int kColumns = 7, kRows = 5;

/// Images of a chessboard from above, files of a folder of their own.
class DetectOrdinary : public InTemporaryFolder {
 protected:
  DetectOrdinary() { target_.layout = ChessboardLayout{{}, kColumns, kRows, 0.03}; }

  static cv::Mat Image(const RenderOptions& options = {.blur = 0.7, .noise = 2}) {
    const GrayFunction board = [](const Eigen::Vector2d& p) {
      if (p.x() < -1 || p.y() < -1 || p.x() > kColumns || p.y() > kRows) return 200.0;
      return static_cast<int>(std::floor(p.x()) + std::floor(p.y())) % 2 == 0 ? 50.0 : 200.0;
    };
    return Render(View(board, TiltedView(24, 0.2, 60, 50)), {280, 220}, options);
  }
  /// Adds the frame 0, 1, ...
  void Save(const std::string& content) {
    const std::string frame = std::to_string(images_.size());
    images_.push_back({frame, folder_ / frame});
    std::ofstream(images_.back().path, std::ios::binary) << content;
  }
  ImageDetections Detect(DetectOptions options = {}) {
    DetectionCache cache(folder_ / "cache", "test", false);
    options.cache = &cache;
    return DetectOrdinaryImages(
        images_, [this] { return MakeMarkerDetector(target_); }, options);
  }

  static std::string Encoded(const std::string& extension, const cv::Mat& image) {
    std::vector<uchar> bytes;
    cv::imencode(extension, image, bytes);
    return {bytes.begin(), bytes.end()};
  }

  Target target_;
  std::vector<FrameImage> images_;
};

TEST_F(DetectOrdinary, KeepsTheOrientationTagsOfItsImages) {
  std::string turned = Encoded(".jpg", Image());
  turned.insert(
      2,
      std::string("\xff\xe1\x00\x22"
                  "Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x08\0\0\0\0\0\0",
                  36));
  Save(turned);
  Save(Encoded(".png", Image()));
  for (const size_t reused : {0, 2}) {
    const ImageDetections found = Detect();
    ASSERT_THAT(found.views, SizeIs(2));
    EXPECT_EQ(found.reused, reused);
    EXPECT_EQ(found.image_size, (ImageSize{280, 220}));
    EXPECT_EQ(found.traits.at("0").orientation, 8);
    EXPECT_EQ(found.traits.at("1").orientation, 1);
  }
}

TEST_F(DetectOrdinary, MeasuresBlurAndSaturationOfTheTarget) {
  Save(Encoded(".png", Image({.blur = 0.7, .noise = 2})));
  Save(Encoded(".png", Image({.blur = 2.5, .noise = 2})));
  cv::Mat light = Image();
  light *= 1.6;
  Save(Encoded(".png", light));
  for (const size_t reused : {0, 3}) {
    const ImageDetections found = Detect();
    ASSERT_THAT(found.views, SizeIs(3));
    EXPECT_EQ(found.reused, reused);
    EXPECT_NEAR(found.traits.at("0").blur, 0.7, 0.3);
    EXPECT_NEAR(found.traits.at("1").blur, 2.5, 0.6);
    EXPECT_EQ(found.traits.at("0").saturated, 0);
    EXPECT_NEAR(found.traits.at("2").saturated, 0.5, 0.1);
  }
}

// What is kept of an earlier run is that of the same image and the same white images.
TEST_F(DetectOrdinary, ReusesNothingOfOtherImagesOrWhiteImages) {
  Save(Encoded(".png", Image()));
  const auto put_white = [this](int level) {
    DetectOptions options;
    for (const char* const name : {"a", "b", "c"}) {
      options.white_images.push_back({name, folder_ / name});
      std::ofstream(folder_ / name, std::ios::binary)
          << Encoded(".png", cv::Mat(220, 280, CV_8U, cv::Scalar(level)));
    }
    return options;
  };
  EXPECT_EQ(Detect().reused, 0U);
  EXPECT_EQ(Detect().reused, 1U);
  const DetectOptions white = put_white(200);
  EXPECT_EQ(Detect(white).reused, 0U);
  EXPECT_EQ(Detect(white).reused, 1U);
  put_white(190);
  EXPECT_EQ(Detect(white).reused, 0U);
  std::ofstream(images_[0].path, std::ios::binary)
      << Encoded(".png", Image({.blur = 0.9, .noise = 2}));
  EXPECT_EQ(Detect(white).reused, 0U);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
