// SPDX-License-Identifier: Apache-2.0
//
// Exposures of a pair's frames from images of one scene at known light.
#include "apps/photometry/frame_exposures.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <opencv2/core.hpp>
#include <random>

#include "calib/base/error.h"
#include "detectors/images/image.h"
#include "detectors/photometry/response_curve.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr int kWidth = 200, kHeight = 150;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

double Attenuation(int x) { return 1 - 0.002 * x; }

class FrameExposuresOfAPair : public Workspace {
 protected:
  FrameExposuresOfAPair() {
    // Random dots of some pixels.
    std::mt19937 engine(2);
    std::uniform_int_distribution<int> x(0, kWidth + 39), y(0, kHeight - 1), grey(30, 110),
        side(3, 8);
    scene_ = cv::Mat(kHeight, kWidth + 40, CV_32F, cv::Scalar(70));
    for (int i = 0; i < 900; ++i) {
      const cv::Rect dot(x(engine), y(engine), side(engine), side(engine));
      scene_(dot & cv::Rect(0, 0, kWidth + 40, kHeight)).setTo(grey(engine));
    }
    recording_.path = "recording.yaml";
    recording_.cameras.resize(2);
    recording_.cameras[0].name = "left";
    recording_.cameras[1].name = "right";
    for (RecordedCamera& camera : recording_.cameras) camera.image_size = {kWidth, kHeight};
  }
  // The scene from `column` on, its light times `factor`; the right camera's has its attenuation.
  void AddImage(size_t c,
                const std::string& frame,
                int column,
                double factor,
                std::optional<double> exposure,
                bool deep = false) {
    cv::Mat image(kHeight, kWidth, deep ? CV_16U : CV_8U);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        double light = factor * scene_.at<float>(y, x + column);
        if (attenuated_ && c == 1) light *= Attenuation(x);
        if (squared_ && c == 1) light = std::sqrt(light * 255);  // U(I) = I^2 / 255
        if (deep) {
          image.at<std::uint16_t>(y, x) = static_cast<std::uint16_t>(std::lround(16 * light));
        } else {
          image.at<std::uint8_t>(y, x) =
              static_cast<std::uint8_t>(std::clamp(std::lround(light), 0L, 255L));
        }
      }
    }
    RecordedCamera& camera = recording_.cameras[c];
    const std::string name = fmt::format("{}_{}.png", camera.name, frame);
    Write(name, EncodeImage(".png", image));
    RecordedImage recorded;
    recorded.frame = frame;
    recorded.path = Path(name);
    recorded.exposure = exposure;
    camera.images.push_back(recorded);
  }
  void AddFrame(const std::string& name,
                double second,
                std::optional<double> exposure = 5,
                bool deep = false) {
    const size_t index = recording_.cameras[0].images.size();
    AddImage(0, name, 20, 1, exposure, deep);
    AddImage(1, name, 8, second, exposure, deep);
    recording_.frames.push_back({name, 0, {index, index}});
  }
  FrameExposures Compare() {
    return CompareExposures(recording_, 1, [&](size_t done, size_t total) {
      steps_.push_back(fmt::format("{}/{}", done, total));
    });
  }
  std::string Refusal(ErrorKind kind) {
    try {
      Compare();
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), kind);
      std::string message = error.what();
      const std::string folder = Path("").string();
      if (message.starts_with(folder)) message.erase(0, folder.size());
      return message;
    }
    return "no refusal";
  }

  cv::Mat scene_;
  bool attenuated_ = false, squared_ = false;
  Recording recording_;
  std::vector<std::string> steps_;
};

TEST_F(FrameExposuresOfAPair, DifferWhereTheSecondCameraIsLate) {
  for (int i = 0; i < 5; ++i) AddFrame(fmt::format("f{}", i), i == 2 ? 1.2 * 1.1 : 1.2);
  const FrameExposures found = Compare();
  EXPECT_THAT(steps_, ElementsAre("0/5", "1/5", "2/5", "3/5", "4/5"));
  EXPECT_THAT(found.left_out, IsEmpty());
  EXPECT_THAT(
      found.warnings,
      ElementsAre(
          "left: without 'response' in recording.yaml its grey values are taken for proportional to the light",
          HasSubstr("right: without")));
  ASSERT_EQ(found.images.size(), 5u);
  for (size_t i = 0; i < 5; ++i) {
    const RelativeExposure& image = found.images[i];
    EXPECT_EQ(image.frame, fmt::format("f{}", i));
    EXPECT_EQ(image.camera, "right");
    EXPECT_EQ(image.recorded, 5);
    EXPECT_EQ(image.differs, i == 2);
    EXPECT_NEAR(image.log_ratio, i == 2 ? std::log(1.1) : 0, 0.004);
    EXPECT_TRUE(image.sigma < 0.01 && image.points > 30) << image.points;
    EXPECT_NEAR(image.Exposure(), i == 2 ? 5 * std::exp(image.log_ratio) : 5, 1e-12);
  }
  const std::string csv = FrameExposuresCsv(recording_, found);
  EXPECT_THAT(csv,
              ::testing::StartsWith("frame,camera,exposure_ms,relative,sigma\nf0,left,5,0,0\n"));
  EXPECT_EQ(Lines(csv).size(), 11u);
  EXPECT_THAT(csv,
              HasSubstr(fmt::format("f2,right,{:.7g},{:.5g},",
                                    found.images[2].Exposure(),
                                    std::expm1(found.images[2].log_ratio))));
  std::vector<std::string> warnings, stages;
  ::plenocal::Run run;
  run.threads = 1;
  run.listener.warning = [&](const std::string& text) { warnings.push_back(text); };
  run.listener.progress = [&](const std::string& stage, size_t, size_t) {
    stages.push_back(stage);
  };
  const std::string text = MeasureExposures(recording_, Path("out"), run);
  EXPECT_EQ(warnings.size(), 2u);
  EXPECT_EQ(stages[4], "exposures: frame 5 of 5");
  EXPECT_EQ(Read("out/exposures.csv"), csv);
  EXPECT_EQ(
      text,
      fmt::format(
          "f2 of right: exposure {:+.1f} % +- {:.1f} % from the recorded 5 ms, by {} points\nexposures differ in 1 of 5 images\n",
          100 * std::expm1(found.images[2].log_ratio),
          100 * found.images[2].sigma,
          found.images[2].points));
}

TEST_F(FrameExposuresOfAPair, AreOfTheLightBehindResponseAndAttenuation) {
  attenuated_ = squared_ = true;
  ResponseCurve::Table table;
  for (size_t k = 0; k < 256; ++k) table[k] = static_cast<double>(k * k) / 255;
  Write("pcalib.txt", PcalibText(ResponseCurve(table)));
  cv::Mat attenuation(kHeight, kWidth, CV_32F);
  for (int i = 0; i < kWidth * kHeight; ++i)
    attenuation.at<float>(i / kWidth, i % kWidth) = static_cast<float>(Attenuation(i % kWidth));
  Write("v.tiff", EncodeImage(".tiff", attenuation));
  recording_.cameras[1].response = Path("pcalib.txt");
  recording_.cameras[1].vignetting = Path("v.tiff");
  for (int i = 0; i < 3; ++i)
    AddFrame(fmt::format("f{}", i), i == 1 ? 1.3 : 1, i == 1 ? std::optional<double>() : 4);
  // The right images' exposures are recorded as twice the left ones': half the light is expected.
  recording_.cameras[1].images[2].exposure = 8;
  const FrameExposures found = Compare();
  EXPECT_THAT(found.warnings, ElementsAre(HasSubstr("left: without")));
  ASSERT_EQ(found.images.size(), 3u);
  EXPECT_NEAR(found.images[0].log_ratio, 0, 0.005);
  EXPECT_NEAR(found.images[1].log_ratio, std::log(1.3), 0.005);
  EXPECT_TRUE(std::isnan(found.images[1].recorded) && std::isnan(found.images[1].Exposure()));
  EXPECT_NEAR(found.images[2].log_ratio, -std::log(2), 0.005);
  EXPECT_LT(found.images[0].sigma, 0.5);
}

TEST_F(FrameExposuresOfAPair, AreOfDeepImagesToo) {
  for (int i = 0; i < 3; ++i) AddFrame(fmt::format("f{}", i), i == 1 ? 1.5 : 1, 5, true);
  const FrameExposures found = Compare();
  ASSERT_EQ(found.images.size(), 3u);
  EXPECT_NEAR(found.images[1].log_ratio, std::log(1.5), 0.003);
  EXPECT_TRUE(found.images[1].differs);
}

TEST_F(FrameExposuresOfAPair, NeedPointsInCommonAndFittingFiles) {
  AddFrame("a", 1);
  AddFrame("b", 4);  // saturated
  const FrameExposures found = Compare();
  ASSERT_EQ(found.images.size(), 1u);
  ASSERT_EQ(found.left_out.size(), 1u);
  EXPECT_EQ(found.left_out[0].where, "right: b");
  EXPECT_THAT(
      found.left_out[0].reason,
      ::testing::MatchesRegex("[0-9]+ points in common that are not clipped; 15 are needed"));
  recording_.frames.erase(recording_.frames.begin());
  EXPECT_THAT(
      Refusal(ErrorKind::kJob),
      ::testing::MatchesRegex(
          "recording.yaml: no frame shows points in two cameras; the first: right: b: [0-9]+ points in common that are not clipped; 15 are needed"));
  recording_.frames[0].image[1].reset();
  EXPECT_EQ(
      Refusal(ErrorKind::kJob),
      "recording.yaml: no frame shows points in two cameras; the first: b: its cameras have no common frame");
  Write("v.tiff", EncodeImage(".tiff", cv::Mat(kHeight, kWidth - 1, CV_32F, cv::Scalar(1))));
  recording_.cameras[1].vignetting = Path("v.tiff");
  EXPECT_EQ(Refusal(ErrorKind::kInput),
            "v.tiff: is 199 x 150 pixels, but the images of right are 200 x 150");
  Write("v.tiff", EncodeImage(".tiff", cv::Mat(kHeight + 1, kWidth, CV_32F, cv::Scalar(1))));
  EXPECT_EQ(Refusal(ErrorKind::kInput),
            "v.tiff: is 200 x 151 pixels, but the images of right are 200 x 150");
  recording_.cameras.resize(1);
  EXPECT_EQ(Refusal(ErrorKind::kInput),
            "recording.yaml: has one camera; exposures of the cameras of a frame are compared");
}

TEST_F(FrameExposuresOfAPair, HaveTheScatterOfTheirPointsBehindTheAttenuation) {
  attenuated_ = true;
  AddFrame("a", 1);
  // sigma * root(points) with a picture of 8 bits as attenuation, which is relative to its largest
  // value.
  const auto scatter_with = [&](const std::function<double(int)>& value) {
    cv::Mat picture(kHeight, kWidth, CV_8U);
    for (int i = 0; i < kWidth * kHeight; ++i)
      picture.at<std::uint8_t>(i / kWidth, i % kWidth) =
          static_cast<std::uint8_t>(std::lround(value(i % kWidth)));
    Write("v.png", EncodeImage(".png", picture));
    recording_.cameras[1].vignetting = Path("v.png");
    const FrameExposures found = Compare();
    EXPECT_EQ(found.images.size(), 1u);
    EXPECT_FALSE(found.images[0].differs);
    return found.images[0].sigma * std::sqrt(static_cast<double>(found.images[0].points));
  };
  EXPECT_LT(scatter_with([](int x) { return 200 * Attenuation(x); }), 0.03);
  // Without it logarithms of an attenuation from 0.6 to 1: the median's standard deviation by that
  // of their distances from it.
  const double flat = scatter_with([](int) { return 200; });
  EXPECT_NEAR(flat, 1.2533 * 1.4826 * 0.107, 0.05);
  // Where there is no light by the attenuation, at least a thousandth counts.
  EXPECT_NEAR(scatter_with([](int) { return 0; }), flat, 1e-3 * flat);
}

TEST_F(FrameExposuresOfAPair, AreOfEachFurtherCameraWithTheFirst) {
  recording_.cameras.resize(3);
  recording_.cameras[2].name = "third";
  recording_.cameras[2].image_size = {kWidth, kHeight};
  for (size_t i = 0; i < 3; ++i) {
    const std::string name = fmt::format("f{}", i);
    AddImage(0, name, 20, 1, {});
    AddImage(2, name, 8, i == 1 ? 1.3 : 1, {});
    recording_.frames.push_back({name, 0, {i, std::nullopt, i}});
  }
  const FrameExposures found = Compare();
  EXPECT_EQ(found.warnings.size(), 3u);
  ASSERT_EQ(found.images.size(), 3u);
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(found.images[i].camera, "third");
    EXPECT_NEAR(found.images[i].log_ratio, i == 1 ? std::log(1.3) : 0, 0.005);
    EXPECT_TRUE(std::isnan(found.images[i].recorded));
  }
  ::plenocal::Run run;
  run.threads = 1;
  EXPECT_EQ(
      MeasureExposures(recording_, {}, run),
      fmt::format(
          "f1 of third: exposure {:+.1f} % +- {:.1f} % from the usual ratio to the first camera's, by {} "
          "points\nexposures differ in 1 of 3 images\n",
          100 * std::expm1(found.images[1].log_ratio),
          100 * found.images[1].sigma,
          found.images[1].points));
  // Images that cannot be read are left out with their reason.
  Write("left_f0.png", "no image");
  const FrameExposures torn = Compare();
  ASSERT_EQ(torn.left_out.size(), 1u);
  EXPECT_EQ(torn.left_out[0].where, "third: f0");
  EXPECT_THAT(torn.left_out[0].reason, HasSubstr("left_f0.png"));
  std::vector<std::string> messages;
  run.listener.message = [&](const std::string& text) { messages.push_back(text); };
  MeasureExposures(recording_, {}, run);
  EXPECT_THAT(messages, ElementsAre("  left out third: f0: " + torn.left_out[0].reason));
}

TEST(RelativeExposure, IsTheRecordedOneUnlessItDiffers) {
  RelativeExposure image{.frame = "a", .camera = "b", .recorded = 4, .log_ratio = std::log(0.5)};
  EXPECT_EQ(image.Exposure(), 4);
  image.differs = true;
  EXPECT_NEAR(image.Exposure(), 2, 1e-12);
  image.recorded = kNaN;
  EXPECT_TRUE(std::isnan(image.Exposure()));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
