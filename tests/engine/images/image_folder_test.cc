// SPDX-License-Identifier: Apache-2.0
#include "engine/images/image_folder.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "models/registry.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
constexpr int kColumns = 4, kRows = 3;

/// Images a, b, c of 4 x 3 pixels, resampled a pixel to the left.
class ResampledFolder : public testing::InTemporaryFolder {
 protected:
  ResampledFolder() {
    record_.cameras.push_back({.name = "left",
                               .model = FindModel(CameraModels(), "pinhole"),
                               .image_size = {kColumns, kRows},
                               .config = {},
                               .params = {4, 4, 1.5, 1},
                               .covariance = Eigen::Matrix4d::Zero(),
                               .T_camera_rig = {}});
    for (int i = 0; i < kColumns * kRows; ++i) {
      map_.x.push_back(static_cast<float>(i % kColumns + 1));
      map_.y.push_back(static_cast<float>(i / kColumns));
    }
    for (const char* frame : {"a", "b", "c"}) {
      images_.push_back({.frame = frame, .path = Path(fmt::format("{}.png", frame))});
      cv::imwrite(images_.back().path.string(), Image());
    }
    run_.threads = 1;
    run_.listener.message = [this](const std::string& line) { messages_ += line + "\n"; };
    run_.listener.progress = [this](const std::string& stage, size_t done, size_t total) {
      progress_.push_back(fmt::format("{} {} of {}", stage, done, total));
      if (done == stop_after_) stop_.request_stop();
    };
    run_.stop = stop_.get_token();
  }
  static cv::Mat Image() {
    cv::Mat image(kRows, kColumns, CV_8U);
    for (int i = 0; i < kColumns * kRows; ++i) {
      image.at<uchar>(i / kColumns, i % kColumns) = static_cast<uchar>(10 + 5 * i);
    }
    return image;
  }
  size_t Resample() {
    OutputFolder out(Path("out"));
    const size_t count = ResampleToFolder(images_,
                                          {.calibration = record_,
                                           .camera = record_.cameras[0],
                                           .map = map_,
                                           .settings = {},
                                           .prefix = "left_",
                                           .keep = &kept_},
                                          run_,
                                          &out);
    out.Commit();
    return count;
  }

  CalibrationRecord record_;
  PixelMap map_{.size = {kColumns, kRows}, .source_size = {kColumns, kRows}, .x = {}, .y = {}};
  std::vector<FrameImage> images_;
  std::map<std::string, std::string> kept_;
  std::string messages_;
  std::vector<std::string> progress_;
  size_t stop_after_ = 0;
  std::stop_source stop_;
  plenocal::Run run_;
};

TEST_F(ResampledFolder, HasTheImagesAndReportsItsProgress) {
  EXPECT_EQ(Resample(), 3U);
  EXPECT_THAT(progress_,
              ElementsAre("left: images 1 of 3", "left: images 2 of 3", "left: images 3 of 3"));
  for (const FrameImage& image : images_) {
    const cv::Mat found =
        cv::imread(Path("out/left_" + image.frame + ".png").string(), cv::IMREAD_UNCHANGED);
    const cv::Rect here(0, 0, kColumns - 1, kRows), there(1, 0, kColumns - 1, kRows);
    EXPECT_EQ(cv::norm(found(here), Image()(there), cv::NORM_INF), 0);
    EXPECT_EQ(kept_.at(image.frame), files_.Read("out/left_" + image.frame + ".png"));
  }
  EXPECT_EQ(messages_, "");
}

TEST_F(ResampledFolder, LeavesOutImagesThatCannotBeUsed) {
  Write("a.png", "no image");
  cv::imwrite(Path("c.png").string(), cv::Mat(kRows, kColumns + 1, CV_8U, cv::Scalar(7)));
  EXPECT_EQ(Resample(), 1U);
  EXPECT_THAT(messages_, HasSubstr("left out " + Path("a.png").string()));
  EXPECT_THAT(messages_, HasSubstr("c.png: is 5 x 3 pixels, but the calibration is of 4 x 3"));
  EXPECT_EQ(kept_.size(), 1U);
  EXPECT_EQ(progress_.size(), 3U);
}

TEST_F(ResampledFolder, IsRefusedWithoutAnyImageThatCanBeUsed) {
  for (const char* name : {"a.png", "b.png", "c.png"}) Write(name, "no image");
  EXPECT_THAT(testing::RefusalOf([&] { Resample(); }), HasSubstr("a.png"));
}

TEST_F(ResampledFolder, StopsWhenTheCallerAsks) {
  stop_after_ = 2;
  EXPECT_THROW(Resample(), Stopped);
  EXPECT_EQ(progress_.size(), 2U);
}

}  // namespace TEST_FILE
}  // namespace plenocal
