// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/white_images.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "calib/base/error.h"
#include "detectors/images/attenuation.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr int kWidth = 160, kHeight = 120;

/// Grey value, before noise, of pixel (x, y).
using Field = std::function<double(int x, int y)>;

double FallOff(int x, int y) {
  const double u = (x - (kWidth - 1) / 2.0) / kWidth, v = (y - (kHeight - 1) / 2.0) / kWidth;
  const double cosine_square = 1 / (1 + u * u + v * v);
  return cosine_square * cosine_square;
}

cv::Mat Sample(const Field& field, int type, unsigned seed, double noise = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  cv::Mat image(kHeight, kWidth, CV_64F);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) image.at<double>(y, x) = field(x, y) + noise * normal(random);
  }
  image.convertTo(image, type);
  return image;
}

class AverageWhiteImagesTest : public testing::InTemporaryFolder {
 protected:
  void Add(const cv::Mat& image) {
    const std::string frame = std::to_string(images_.size());
    images_.push_back({frame, folder_ / (frame + ".png")});
    cv::imwrite(images_.back().path.string(), image);
  }
  void AddEven(int count, double level = 120) {
    for (int i = 0; i < count; ++i) {
      Add(Sample([=](int x, int y) { return level * FallOff(x, y); }, CV_8U, ++seed_));
    }
  }
  [[nodiscard]] std::string Message(ErrorKind kind) const {
    return testing::RefusalOf([&] { AverageWhiteImages(images_, 1); }, kind);
  }

  std::vector<FrameImage> images_;
  unsigned seed_ = 0;
};

TEST_F(AverageWhiteImagesTest, IsTheMeanOfTheField) {
  AddEven(9);
  const WhiteImages white = AverageWhiteImages(images_, 2);
  EXPECT_EQ(white.members.size(), 9u);
  EXPECT_THAT(white.left_out, IsEmpty());
  EXPECT_EQ(white.full_scale, 255);
  EXPECT_EQ(white.saturated, 0);
  EXPECT_EQ(white.black, 0);
  double sum = 0;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      EXPECT_NEAR(white.mean.at<float>(y, x), 120 * FallOff(x, y), 2.2) << x << ", " << y;
      sum += 120 * FallOff(x, y);
    }
  }
  EXPECT_NEAR(white.level, sum / (kWidth * kHeight), 0.05);
  EXPECT_LT(white.unevenness, 0.005) << "fall-off is alike on both sides";
}

TEST_F(AverageWhiteImagesTest, MeasuresTheUnevennessOfTheLight) {
  Add(Sample(
      [](int x, int) { return 100 * (1 + 0.1 * ((x + 0.5) / kWidth - 0.5)); }, CV_16U, 1, 0));
  // 16 grey levels between the sides of a field of 100: a tenth.
  EXPECT_NEAR(AverageWhiteImages(images_, 1).unevenness, 0.1, 0.02);
}

TEST_F(AverageWhiteImagesTest, LeavesOutWhatDiffersFromTheRest) {
  AddEven(8);
  Add(cv::Mat(kHeight, kWidth, CV_8U, cv::Scalar(255)));
  Add(cv::Mat(kHeight, kWidth, CV_8U, cv::Scalar(1)));
  AddEven(1, 60);  // a lamp that was off
  Add(Sample([](int x, int) { return x < kWidth / 2 ? 56.0 : 136.0; }, CV_8U, 99));
  const WhiteImages white = AverageWhiteImages(images_, 2);
  EXPECT_EQ(white.members.size(), 8u);
  ASSERT_THAT(white.left_out, SizeIs(4));
  const std::vector<std::string> reasons{"saturated", "black", "brightness", "shading"};
  for (std::size_t i = 0; i < reasons.size(); ++i) {
    EXPECT_EQ(white.left_out[i].where, images_[8 + i].path.string());
    EXPECT_THAT(white.left_out[i].reason, HasSubstr(reasons[i]));
  }
  // What was left out is in the mean no more.
  EXPECT_NEAR(white.mean.at<float>(60, 80), 120 * FallOff(80, 60), 2.2);
}

TEST_F(AverageWhiteImagesTest, LeavesOutUnreadableFiles) {
  AddEven(3);
  images_.push_back({"gone", folder_ / "gone.png"});
  const WhiteImages white = AverageWhiteImages(images_, 1);
  EXPECT_EQ(white.members.size(), 3u);
  ASSERT_THAT(white.left_out, SizeIs(1));
  EXPECT_THAT(white.left_out[0].reason, HasSubstr("no such file"));
}

TEST_F(AverageWhiteImagesTest, FullScaleIsThatOfTheBitsInUse) {
  // 12 bits in the upper bits of 16.
  const auto high = [](int x, int y) { return 16 * std::round(3000 * FallOff(x, y)); };
  Add(Sample(high, CV_16U, 1, 0));
  Add(Sample(high, CV_16U, 2, 0));
  EXPECT_EQ(AverageWhiteImages(images_, 1).full_scale, 16 * 4095);
}

TEST_F(AverageWhiteImagesTest, FullScaleIsThatOfAllColumnsOfAColour) {
  // 12 bits in the lower bits of 16; the highest is set in the last columns alone.
  cv::Mat colour;
  cv::merge(std::vector<cv::Mat>(
                3, Sample([](int x, int) { return x < 140 ? 1500 : 2500; }, CV_16U, 1, 20)),
            colour);
  Add(colour);
  EXPECT_EQ(AverageWhiteImages(images_, 1).full_scale, 4095);
}

TEST_F(AverageWhiteImagesTest, CountsSaturatedAndBlackPixels) {
  for (int k = 0; k < 4; ++k) {
    cv::Mat image = Sample([](int x, int y) { return 120 * FallOff(x, y); }, CV_8U, 1 + k);
    image(cv::Rect(0, 0, 10, 4)) = 255;
    if (k == 0) image(cv::Rect(20, 20, 6, 5)) = 0;
    Add(image);
  }
  const WhiteImages white = AverageWhiteImages(images_, 1);
  ASSERT_EQ(white.members.size(), 4);
  const auto pixels = static_cast<double>(white.mean.total());
  EXPECT_NEAR(white.saturated, 40 / pixels, 1e-9);
  EXPECT_NEAR(white.black, 30 / pixels / 4, 1e-9);
}

TEST_F(AverageWhiteImagesTest, RefusesImagesWithNothingInCommon) {
  for (int k = 0; k < 6; ++k) {
    Add(Sample([k](int x, int y) { return 90 + 60 * std::sin(0.1 * (x + k * y) + k); }, CV_8U, 1));
  }
  EXPECT_THAT(Message(ErrorKind::kJob), HasSubstr("a scene or a light that changes"));
}

TEST_F(AverageWhiteImagesTest, RefusesDifferentSizes) {
  AddEven(2);
  Add(cv::Mat(50, 70, CV_8U, cv::Scalar(100)));
  EXPECT_THAT(Message(ErrorKind::kInput), HasSubstr("is 70 x 50 pixels"));
}

TEST_F(AverageWhiteImagesTest, RefusesWhenNoneIsOfUse) {
  Add(cv::Mat(kHeight, kWidth, CV_8U, cv::Scalar(255)));
  EXPECT_THAT(Message(ErrorKind::kJob), HasSubstr("no white image is of use"));
  images_ = {{"gone", folder_ / "gone.png"}};
  EXPECT_THAT(Message(ErrorKind::kJob), HasSubstr("no white image can be read"));
}

cv::Mat Exact(const Field& field, double noise) { return Sample(field, CV_32F, 5, noise); }

TEST(SmoothAttenuation, IsTheFallOff) {
  const cv::Mat attenuation =
      SmoothAttenuation(Exact([](int x, int y) { return 150 * FallOff(x, y); }, 1), std::nullopt);
  for (int y = 10; y < kHeight; y += 20) {
    for (int x = 10; x < kWidth; x += 20) {
      EXPECT_NEAR(attenuation.at<float>(y, x), FallOff(x, y), 0.01) << x << ", " << y;
    }
  }
}

TEST(SmoothAttenuation, IsThatOfEachPlaneOfAMosaic) {
  const auto mosaic = [](int x, int y) {
    return 150 * FallOff(x, y) * std::vector{0.5, 1.0, 1.0, 0.3}[2 * (y % 2) + x % 2];
  };
  const cv::Mat attenuation = SmoothAttenuation(Exact(mosaic, 0.1), BayerOrder::kRggb);
  for (int y = 10; y < kHeight; y += 17) {
    for (int x = 10; x < kWidth; x += 17) {
      EXPECT_NEAR(attenuation.at<float>(y, x), FallOff(x, y), 0.015) << x << ", " << y;
    }
  }
}

TEST(SmoothAttenuation, StaysAboveZero) {
  const cv::Mat attenuation =
      SmoothAttenuation(Exact([](int x, int) { return x < 40 ? 0.0 : 100.0; }, 0), std::nullopt);
  double lowest = 0, highest = 0;
  cv::minMaxLoc(attenuation, &lowest, &highest);
  EXPECT_GT(lowest, 0);
  EXPECT_LE(highest, 1);
}

TEST(CheckEvenField, AcceptsFallOffAndRefusesScenes) {
  EXPECT_NO_THROW(CheckEvenField(Exact([](int x, int y) { return 100 * FallOff(x, y); }, 1)));
  EXPECT_THROW(CheckEvenField(Exact(
                   [](int x, int y) { return (x / 20 + y / 20) % 2 == 0 ? 60.0 : 160.0; }, 1)),
               Error);
}

TEST(PlaneDifference, TellsMosaicsFromGreyImages) {
  const auto grey = [](int x, int y) { return 100 * FallOff(x, y); };
  EXPECT_EQ(PlaneDifference(Exact(grey, 3)), 0);
  EXPECT_TRUE(PlanesAgree(Exact(grey, 3)));
  const auto mosaic = [&](int x, int y) { return grey(x, y) * (x % 2 == y % 2 ? 1.1 : 0.9); };
  EXPECT_NEAR(PlaneDifference(Exact(mosaic, 3)), 0.2, 0.01);
  EXPECT_FALSE(PlanesAgree(Exact(mosaic, 3)));
  EXPECT_FALSE(PlanesAgree(cv::Mat::zeros(48, 64, CV_32F)));
}

TEST(GreenDifference, ShowsAColourOrderThatIsShiftedByAPixel) {
  const auto rggb = [&](int x, int y) {
    const double colour = x % 2 != y % 2 ? 1 : x % 2 == 0 ? 0.6 : 0.7;
    return 100 * FallOff(x, y) * colour;
  };
  const cv::Mat white = Exact(rggb, 3);
  EXPECT_EQ(GreenDifference(white, BayerOrder::kRggb), 0);
  EXPECT_EQ(GreenDifference(white, BayerOrder::kBggr), 0) << "equal greens";
  EXPECT_NEAR(GreenDifference(white, BayerOrder::kGrbg), 0.1 / 0.825, 0.01);
  EXPECT_GT(GreenDifference(white, BayerOrder::kGbrg), 0);
}

TEST(LargeScaleMean, IsAtLeastAThousandthOfTheMean) {
  for (const double light : {1000.0, 0.1}) {
    cv::Mat image(480, 640, CV_32F, cv::Scalar(0));
    image(cv::Rect(0, 0, 64, 48)).setTo(light);
    double least = 0;
    cv::minMaxLoc(LargeScaleMean(image), &least);
    EXPECT_NEAR(least / (1e-3 * 0.01 * light), 1, 1e-4) << "a hundredth of the image is lit";
  }
}

TEST(LargeScaleMean, IsAlikeAlongRowsAndColumns) {
  cv::Mat image(300, 200, CV_32F), turned, mean;
  cv::randu(image, 50, 150);
  image.rowRange(100, 140) += 60;
  cv::transpose(image, turned);
  cv::transpose(LargeScaleMean(turned), mean);
  EXPECT_LT(cv::norm(mean, LargeScaleMean(image), cv::NORM_INF), 1e-3);
}

}  // namespace TEST_FILE
}  // namespace plenocal
