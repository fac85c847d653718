// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/image_answer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "models/registry.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::workbench {
namespace TEST_FILE {

class ImageAnswers : public plenocal::testing::InTemporaryFolder {
 protected:
  FrameImage Put(const std::string& name, const cv::Mat& image) const {
    cv::imwrite((folder_ / name).string(), image);
    return {.frame = "1", .path = (folder_ / name).string()};
  }
  static cv::Mat Decoded(const Answer& answer) {
    EXPECT_EQ(answer.type, "image/jpeg");
    const std::vector<uchar> bytes(answer.body.begin(), answer.body.end());
    return cv::imdecode(bytes, cv::IMREAD_UNCHANGED);
  }
  static int At(const cv::Mat& image, int x, int y) { return image.at<uchar>(y, x); }
};

// Dark on the left, bright on the right.
cv::Mat Halves(int depth, double dark, double bright) {
  cv::Mat image(48, 64, CV_MAKETYPE(depth, 1), cv::Scalar(dark));
  image.colRange(32, 64).setTo(bright);
  return image;
}

TEST_F(ImageAnswers, AreOfEightBitsAndAtMostTheWidth) {
  const FrameImage image = Put("image.png", Halves(CV_8U, 50, 200));
  const cv::Mat whole = Decoded(ImageAnswer(folder_, image, 0));
  EXPECT_EQ(whole.size(), cv::Size(64, 48));
  EXPECT_NEAR(At(whole, 10, 20), 50, 3);
  EXPECT_NEAR(At(whole, 50, 20), 200, 3);
  EXPECT_EQ(Decoded(ImageAnswer(folder_, image, 32)).size(), cv::Size(32, 24));
  EXPECT_EQ(Decoded(ImageAnswer(folder_, image, 640)).size(), cv::Size(64, 48));
  // The brightest of 16 bits is white.
  const FrameImage deep = Put("deep.png", Halves(CV_16U, 1000, 4000));
  const cv::Mat reduced = Decoded(ImageAnswer(folder_, deep, 0));
  EXPECT_NEAR(At(reduced, 10, 20), 255 / 4, 3);
  EXPECT_NEAR(At(reduced, 50, 20), 255, 3);
}

// A pinhole camera whose middle is the image's stays as it is; of two side by side the left comes
// first.
TEST_F(ImageAnswers, OfPinholeCamerasAreTheirImages) {
  CalibratedCamera left;
  left.name = "left";
  left.model = FindModel(CameraModels(), "pinhole");
  left.params = {60, 60, 31.5, 23.5};
  left.image_size = {64, 48};
  CalibratedCamera right = left;
  right.name = "right";
  right.T_camera_rig.t.x() = -0.1;
  const FrameImage image = Put("left.png", Halves(CV_8U, 50, 200)),
                   other = Put("right.png", Halves(CV_8U, 220, 90));
  const cv::Mat undistorted = Decoded(UndistortedAnswer(folder_, image, left));
  EXPECT_NEAR(At(undistorted, undistorted.cols / 2 - 6, undistorted.rows / 2), 50, 4);
  EXPECT_NEAR(At(undistorted, undistorted.cols / 2 + 6, undistorted.rows / 2), 200, 4);
  const cv::Mat pair = Decoded(RectifiedAnswer(folder_, {image, other}, {&left, &right}));
  const int width = pair.cols / 2;
  EXPECT_NEAR(At(pair, width / 2 - 6, pair.rows / 2), 50, 4);
  EXPECT_NEAR(At(pair, width / 2 + 6, pair.rows / 2), 200, 4);
  EXPECT_NEAR(At(pair, width + width / 2 - 6, pair.rows / 2), 220, 4);
  EXPECT_NEAR(At(pair, width + width / 2 + 6, pair.rows / 2), 90, 4);
  left.image_size = {640, 480};
  EXPECT_EQ(plenocal::testing::RefusalOf([&] { UndistortedAnswer(folder_, image, left); }),
            "left: the image has 64 x 48 px, the calibration 640 x 480");
}

TEST_F(ImageAnswers, OfDepthsAreSampledForTheScreen) {
  cv::Mat depth(3, 1025, CV_32F);
  for (int x = 0; x < depth.cols; ++x) depth.col(x).setTo(2 + 1e-3 * x);
  depth.at<float>(0, 3) = std::numeric_limits<float>::quiet_NaN();
  Put("depth.tiff", depth);
  const nlohmann::json json = DepthJson(folder_, folder_ / "depth.tiff");
  EXPECT_EQ(json["size"], (std::vector{1025, 3}));
  EXPECT_EQ(json["step"], 3);
  EXPECT_EQ(json["columns"], 342);
  EXPECT_EQ(json["rows"], 1);
  ASSERT_EQ(json["depth"].size(), 342);
  EXPECT_EQ(json["depth"][0], 2.0);
  EXPECT_TRUE(std::isnan(json["depth"][1].get<double>()));
  EXPECT_EQ(json["depth"][2], 2.006);
  EXPECT_EQ(json["depth"][341], 3.023);
  EXPECT_NE(json.dump().find("[2.0,null,2.006,"), std::string::npos);
  Put("small.tiff", depth(cv::Rect(10, 0, 512, 3)));
  const nlohmann::json small = DepthJson(folder_, folder_ / "small.tiff");
  EXPECT_EQ(small["step"], 1);
  EXPECT_EQ(small["depth"].size(), 1536);
  EXPECT_EQ(small["depth"][512], 2.01);
}

}  // namespace TEST_FILE
}  // namespace plenocal::workbench
