// SPDX-License-Identifier: Apache-2.0
#include "detectors/photometry/photon_transfer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "calib/io/yaml.h"
#include "detectors/images/white_images.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::IsEmpty;

constexpr int kWidth = 320, kHeight = 240;
constexpr double kGain = 0.35, kRead = 1.4;

/// Grey values added to a pixel, and to its noise.
struct Fault {
  double offset = 0, noise = 0;
};
using Faults = std::map<std::pair<int, int>, Fault>;

double FallOff(int x, int y) {
  const double u = (x - kWidth / 2.0) / kWidth, v = (y - kHeight / 2.0) / kWidth;
  return std::pow(1 / (1 + 2 * (u * u + v * v)), 2);
}

class PhotonTransferTest : public testing::InTemporaryFolder {
 protected:
  /// Raw values of 12 bits; lamp and its place vary by percents from image to image.
  void AddRaw(int count, double level, const Faults& faults = {}) {
    std::mt19937 random(7);
    std::normal_distribution<double> normal;
    for (int i = 0; i < count; ++i) {
      const double lamp = 1 + 0.01 * normal(random), tilt = 0.02 * normal(random);
      cv::Mat image(kHeight, kWidth, CV_16U);
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x) {
          double mean = level * lamp * (1 + tilt * (x - kWidth / 2.0) / kWidth) * FallOff(x, y);
          double sigma = std::sqrt(kRead * kRead + kGain * mean);
          if (const auto fault = faults.find({x, y}); fault != faults.end()) {
            mean += fault->second.offset;
            sigma += fault->second.noise;
          }
          image.at<std::uint16_t>(y, x) =
              cv::saturate_cast<std::uint16_t>(mean + sigma * normal(random));
        }
      }
      Add(image);
    }
  }
  void Add(const cv::Mat& image) {
    const std::string frame = std::to_string(images_.size());
    images_.push_back({frame, folder_ / (frame + ".png")});
    cv::imwrite(images_.back().path.string(), image);
  }
  [[nodiscard]] std::optional<PhotonTransfer> Measure(std::optional<BayerOrder> bayer = {}) const {
    return MeasurePhotonTransfer(images_, AverageWhiteImages(images_, 1), bayer);
  }

  std::vector<FrameImage> images_;
};

TEST_F(PhotonTransferTest, FindsGainAndReadNoise) {
  AddRaw(12, 2500);
  const auto noise = Measure();
  ASSERT_TRUE(noise);
  EXPECT_NEAR(noise->gain, kGain, 4 * noise->gain_sigma);
  EXPECT_LT(noise->gain_sigma, 0.02 * kGain);
  const double read = std::hypot(kRead, 1 / std::sqrt(12.0));
  EXPECT_NEAR(noise->read, read, 4 * noise->read_sigma);
  EXPECT_LT(noise->misfit, 0.03);
  EXPECT_EQ(noise->saturation, 4095);
  EXPECT_THAT(noise->defects, IsEmpty());
}

// The levels of a dark image differ in their standard errors by an order of magnitude.
TEST_F(PhotonTransferTest, IsTheWeightedLineThroughItsLevels) {
  AddRaw(6, 60);
  const auto noise = Measure();
  ASSERT_TRUE(noise);
  const auto count = static_cast<Eigen::Index>(noise->levels.size());
  Eigen::MatrixX2d A(count, 2);
  Eigen::VectorXd b(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const NoiseLevel& level = noise->levels[static_cast<size_t>(i)];
    A.row(i) << level.level / level.sigma, 1 / level.sigma;
    b[i] = level.variance / level.sigma;
  }
  const Eigen::Vector2d line = A.colPivHouseholderQr().solve(b);
  EXPECT_NEAR(noise->gain, line[0], 1e-9);
  EXPECT_NEAR(noise->read, std::sqrt(line[1]), 1e-9);
  const double chi2 = (b - A * line).squaredNorm() / static_cast<double>(count - 2);
  const Eigen::Matrix2d covariance = std::max(1.0, chi2) * (A.transpose() * A).inverse();
  EXPECT_NEAR(noise->gain_sigma, std::sqrt(covariance(0, 0)), 1e-9);
  EXPECT_NEAR(noise->read_sigma, std::sqrt(covariance(1, 1)) / (2 * noise->read), 1e-9);
}

TEST_F(PhotonTransferTest, NamesDefectivePixels) {
  AddRaw(8,
         1000,
         {{{40, 30}, {.offset = 600}},
          {{200, 100}, {.offset = -400}},
          {{11, 220}, {.offset = 0, .noise = 100}}});
  for (const auto& bayer : {std::optional<BayerOrder>{}, std::optional(BayerOrder::kRggb)}) {
    const auto noise = Measure(bayer);
    ASSERT_TRUE(noise);
    std::vector<std::pair<int, int>> places;
    for (const DefectivePixel& pixel : noise->defects) places.emplace_back(pixel.x, pixel.y);
    ASSERT_THAT(places,
                ::testing::ElementsAre(std::pair(40, 30), std::pair(200, 100), std::pair(11, 220)));
    EXPECT_EQ(noise->defects[0].defect, PixelDefect::kBright);
    EXPECT_EQ(noise->defects[1].defect, PixelDefect::kDark);
    EXPECT_EQ(noise->defects[2].defect, PixelDefect::kNoisy);
    EXPECT_NEAR(noise->gain, kGain, 5 * noise->gain_sigma) << "defects have no part in it";
  }
}

// A mosaic whose colours differ fourfold in brightness: a defect is one beside pixels of its
// colour.
TEST_F(PhotonTransferTest, ComparesPixelsOfOneColour) {
  Faults faults;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = y % 2; x < kWidth; x += 2) faults[{x, y}].offset = 1500;
  }
  faults[{40, 30}].offset -= 600;
  faults[{41, 60}].offset += 600;
  AddRaw(8, 500, faults);
  const auto noise = Measure(BayerOrder::kRggb);
  ASSERT_TRUE(noise);
  std::vector<std::pair<int, int>> places;
  for (const DefectivePixel& pixel : noise->defects) places.emplace_back(pixel.x, pixel.y);
  EXPECT_THAT(places, ::testing::ElementsAre(std::pair(40, 30), std::pair(41, 60)));
}

TEST_F(PhotonTransferTest, ProcessedImagesDeviateFromTheLine) {
  AddRaw(8, 3000);
  for (const FrameImage& image : images_) {
    const cv::Mat raw = cv::imread(image.path.string(), cv::IMREAD_UNCHANGED);
    cv::Mat bright = raw.clone();
    // A curve that is flat in the highlights, as of a processed picture.
    for (auto& value : cv::Mat_<std::uint16_t>(bright)) {
      value = static_cast<std::uint16_t>(4095 * std::pow(value / 4095.0, 0.3));
    }
    cv::imwrite(image.path.string(), bright);
  }
  const auto noise = Measure();
  ASSERT_TRUE(noise);
  EXPECT_GT(noise->misfit, 0.1);
}

TEST_F(PhotonTransferTest, OneImageHasNoDifferences) {
  AddRaw(1, 1000);
  EXPECT_FALSE(Measure());
}

// One level of brightness leaves gain and read noise open.
TEST_F(PhotonTransferTest, FewPixelsDoNotSeparateGainAndReadNoise) {
  AddRaw(4, 1000);
  for (const FrameImage& image : images_) {
    const cv::Mat all = cv::imread(image.path.string(), cv::IMREAD_UNCHANGED);
    cv::imwrite(image.path.string(), all({40, 30, 7, 7}));
  }
  const auto noise = Measure();
  ASSERT_TRUE(noise);
  EXPECT_TRUE(std::isinf(noise->gain_sigma));
  EXPECT_TRUE(std::isinf(noise->read_sigma));
  EXPECT_TRUE(std::isfinite(noise->read));
}

TEST_F(PhotonTransferTest, TheFileIsYaml) {
  AddRaw(3, 1000, {{{40, 30}, {.offset = 600}}});
  const auto noise = Measure();
  ASSERT_TRUE(noise);
  const YamlNode root = YamlNode::Parse(PhotonTransferYaml(*noise), "noise.yaml");
  root.CheckVersion();
  EXPECT_NEAR(root.At("gain").At("value").AsNumber(), noise->gain, 1e-9);
  EXPECT_EQ(root.At("levels").Elements().size(), noise->levels.size());
  EXPECT_EQ(root.At("defects").Elements().at(0).At("x").AsInteger(), 40);
}

}  // namespace TEST_FILE
}  // namespace plenocal
