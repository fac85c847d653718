// SPDX-License-Identifier: Apache-2.0
#include "engine/resample/remap.h"

#include <gmock/gmock.h>

#include <cmath>
#include <map>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "detectors/images/image.h"
#include "detectors/images/image_codecs.h"
#include "engine/resample/map_files.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

// A view of 3 x 2 pixels of an image of 8 x 6: one place between two pixels, one beyond the image,
// one on its very edge.
PixelMap Map() {
  return {.size = {3, 2},
          .source_size = {8, 6},
          .x = {2, 2.5, PixelMap::kNowhere, 7.4F, 7.6F, 5},
          .y = {1, 1, PixelMap::kNowhere, 3, 3, 5}};
}

// 20 x + y.
cv::Mat Image() {
  cv::Mat image(6, 8, CV_8U);
  for (int y = 0; y < 6; ++y) {
    for (int x = 0; x < 8; ++x) image.at<uchar>(y, x) = static_cast<uchar>(20 * x + y);
  }
  return image;
}

std::vector<int> Values(const cv::Mat& image) { return {image.begin<uchar>(), image.end<uchar>()}; }

TEST(Remap, TakesEachPixelFromItsPlace) {
  const Remap linear(Map(), "linear"), nearest(Map(), "nearest");
  EXPECT_THAT(Values(linear(Image())), ElementsAre(41, 51, 0, 143, 0, 105));
  EXPECT_THAT(Values(linear.Mask()), ElementsAre(255, 255, 0, 255, 0, 255));
  const std::vector<int> whole = Values(nearest(Image()));
  EXPECT_EQ(whole[0], 41);
  EXPECT_TRUE(whole[1] == 41 || whole[1] == 61) << whole[1];
  for (const char* name : {"cubic", "lanczos"}) {
    EXPECT_NEAR(Values(Remap(Map(), name)(Image()))[1], 51, 1) << name;
  }
  EXPECT_THAT(testing::RefusalOf([] { const Remap none(Map(), "lanczos3"); }),
              HasSubstr("expected one of linear, nearest, cubic, lanczos, found 'lanczos3'"));
}

std::vector<std::uint8_t> Bytes(const std::string& text) { return {text.begin(), text.end()}; }

cv::Mat Decoded(const std::string& png) { return DecodeImage(Bytes(png), Channels::kAsStored); }

TEST(MapFiles, AreImagesOrOneFileStorage) {
  const PixelMap map = Map();
  const std::vector<double> pinhole{500, 510, 1.5, 0.5};
  const std::map<std::string, std::string> images = MapFiles(map, pinhole, "");
  ASSERT_EQ(images.size(), 3U);
  const cv::Mat x = DecodeFloat(Bytes(images.at("map_x.tiff")), "x"),
                y = DecodeFloat(Bytes(images.at("map_y.tiff")), "y");
  EXPECT_EQ(x.size(), cv::Size(3, 2));
  EXPECT_EQ(std::vector<float>(x.begin<float>(), x.end<float>()), map.x);
  EXPECT_EQ(std::vector<float>(y.begin<float>(), y.end<float>()), map.y);
  EXPECT_THAT(Values(Decoded(images.at("mask.png"))), ElementsAre(255, 255, 0, 255, 0, 255));
  for (const char* format : {"yml", "xml"}) {
    const std::string text = MapFiles(map, pinhole, format).at("");
    cv::FileStorage storage(text, cv::FileStorage::READ | cv::FileStorage::MEMORY);
    EXPECT_EQ(static_cast<int>(storage["image_width"]), 3) << format;
    EXPECT_EQ(static_cast<int>(storage["image_height"]), 2);
    EXPECT_EQ(static_cast<int>(storage["source_width"]), 8);
    EXPECT_EQ(static_cast<int>(storage["source_height"]), 6);
    cv::Mat K, of_x, of_y;
    storage["camera_matrix"] >> K;
    storage["map_x"] >> of_x;
    storage["map_y"] >> of_y;
    EXPECT_EQ(cv::norm(K, cv::Mat(cv::Matx33d(500, 0, 1.5, 0, 510, 0.5, 0, 0, 1))), 0);
    EXPECT_EQ(cv::norm(of_x, x), 0);
    EXPECT_EQ(cv::norm(of_y, y), 0);
  }
}

TEST(VignettePng, HasItsLargestValueAtFullScale) {
  const cv::Mat attenuation = (cv::Mat_<float>(1, 3) << 0.25F, 0.5F, 0.8F);
  const cv::Mat image = Decoded(VignettePng(attenuation));
  ASSERT_EQ(image.type(), CV_16U);
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(image.at<std::uint16_t>(i), std::lround(65535 * attenuation.at<float>(i) / 0.8));
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
