// SPDX-License-Identifier: Apache-2.0
#include "detectors/boards/propose_target.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "targets/target.h"
#include "targets/target_drawing.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kTexels = 6000;  // per metre

/// A target that lies in one plane, as printed.
cv::Mat Print(const Target& target) {
  const TargetPart part = DrawTarget(target).front();
  constexpr int kShift = 4;  // binary digits of a texel
  const auto texel = [&](const Eigen::Vector2d& p) {
    const Eigen::Vector2d at = (p - part.paper.min()) * kTexels * (1 << kShift);
    return cv::Point(static_cast<int>(std::lround(at.x())), static_cast<int>(std::lround(at.y())));
  };
  const Eigen::Vector2d size = part.paper.sizes() * kTexels;
  cv::Mat print(static_cast<int>(size.y()), static_cast<int>(size.x()), CV_8UC1, cv::Scalar(220));
  for (const Polygon& polygon : part.black) {
    std::vector<cv::Point> points;
    for (const Eigen::Vector2d& p : polygon) points.push_back(texel(p));
    cv::fillPoly(print, std::vector{points}, cv::Scalar(30), cv::LINE_8, kShift);
  }
  for (const Disc& disc : part.black_discs) {
    cv::circle(print,
               texel(disc.centre),
               static_cast<int>(disc.radius * kTexels * (1 << kShift)),
               cv::Scalar(30),
               cv::FILLED,
               cv::LINE_8,
               kShift);
  }
  return print;
}

/// Tilted a little, differently in each view, and turned by quarters with the views.
cv::Mat ViewOf(const cv::Mat& print, int view, cv::Size size) {
  const auto w = static_cast<float>(print.cols), h = static_cast<float>(print.rows);
  const float reach = 0.42F * static_cast<float>(std::min(size.width, size.height));
  const float x = static_cast<float>(size.width) / 2, y = static_cast<float>(size.height) / 2;
  const float a = reach * std::min(1.F, w / h), b = reach * std::min(1.F, h / w);
  const float tilt = 0.06F * static_cast<float>(view % 3 - 1);
  std::vector<cv::Point2f> to{{x - a * (1 - tilt), y - b},
                              {x + a * (1 - tilt), y - b},
                              {x + a * (1 + tilt), y + b * 0.95F},
                              {x - a * (1 + tilt), y + b * 0.97F}};
  const std::vector<cv::Point2f> from{{0, 0}, {w, 0}, {w, h}, {0, h}};
  cv::Mat image;
  cv::Mat smooth;
  cv::GaussianBlur(print, smooth, {}, 0.4 * static_cast<double>(w) / (2 * a));
  cv::warpPerspective(smooth,
                      image,
                      cv::getPerspectiveTransform(from, to),
                      size,
                      cv::INTER_LINEAR,
                      cv::BORDER_CONSTANT,
                      cv::Scalar(220));
  return image;
}

class ProposedTarget : public testing::InTemporaryFolder {
 protected:
  void Save(const cv::Mat& image) {
    const auto path = folder_ / fmt::format("{}.png", images_.size());
    ASSERT_TRUE(cv::imwrite(path.string(), image));
    images_.push_back({path.stem().string(), path});
  }

  /// Of three views of a target.
  TargetProposals Of(const std::string& word, cv::Size size = {640, 480}) {
    images_.clear();
    const cv::Mat print = Print(TargetOfWord(word));
    for (int view = 0; view < 3; ++view) Save(ViewOf(print, view, size));
    return ProposeTargets(images_, {.threads = 1});
  }

  void ExpectWord(const std::string& word, const std::string& proposed) {
    const TargetProposals proposals = Of(word);
    ASSERT_FALSE(proposals.found.empty()) << word;
    EXPECT_EQ(proposals.found[0].word, proposed);
    EXPECT_EQ(proposals.found[0].images, 3U) << word;
    EXPECT_EQ(proposals.looked_at, 3U);
  }

  std::vector<FrameImage> images_;
};

TEST_F(ProposedTarget, IsAChessboardWithItsInnerCorners) {
  ExpectWord("chessboard:9x6:25mm", "chessboard:9x6:SIZE");
  ExpectWord("chessboard:5x8:25mm", "chessboard:8x5:SIZE");
  const TargetProposals proposals = Of("chessboard:7x7:25mm", {480, 640});
  ASSERT_FALSE(proposals.found.empty());
  EXPECT_EQ(proposals.found[0].what, "chessboard with 7 x 7 inner corners");
  EXPECT_EQ(proposals.found[0].keys, "type: chessboard\ncolumns: 7\nrows: 7\n");
  EXPECT_EQ(proposals.found[0].measure[0].name, "square");
}

TEST_F(ProposedTarget, IsAnAprilGridWithFamilyAndIds) {
  ExpectWord("aprilgrid:5x4:40mm:0.3", "aprilgrid:5x4:SIZE:SPACING");
  ExpectWord("aprilgrid:3x5:40mm:0.2:tag25h9:border_bits=1",
             "aprilgrid:3x5:SIZE:SPACING:tag25h9:border_bits=1");
  ExpectWord("aprilgrid:4x3:40mm:0.5:tag36h11:first_id=20",
             "aprilgrid:4x3:SIZE:SPACING:first_id=20");
  EXPECT_THAT(Of("aprilgrid:4x3:40mm:0.5").found[0].what, HasSubstr("gaps of about 0.5"));
}

TEST_F(ProposedTarget, IsACharucoBoardWithItsDictionary) {
  ExpectWord("charuco:5x7:36mm:22mm:6X6_250", "charuco:5x7:SQUARE:MARKER:6X6_50");
  ExpectWord("charuco:8x5:36mm:27mm:4X4_100", "charuco:8x5:SQUARE:MARKER:4X4_50");
  ExpectWord("charuco:6x6:36mm:24mm:5X5_50:legacy=true", "charuco:6x6:SQUARE:MARKER:5X5_50");
}

TEST_F(ProposedTarget, IsACharucoBoardPrintedWhiteOnBlack) {
  const cv::Mat print = Print(TargetOfWord("charuco:4x5:54mm:40mm:4X4_1000"));
  for (int view = 0; view < 3; ++view) Save(255 - ViewOf(print, view, {640, 480}));
  const TargetProposals proposals = ProposeTargets(images_, {});
  ASSERT_EQ(proposals.found.size(), 1U);
  EXPECT_EQ(proposals.found[0].word, "charuco:4x5:SQUARE:MARKER:4X4_50");
}

TEST_F(ProposedTarget, IsAGridOfCircles) {
  ExpectWord("circles:8x6:25mm", "circles:8x6:SPACING:symmetric");
  ExpectWord("circles:4x11:20mm:asymmetric", "circles:4x11:SPACING:asymmetric");
  const TargetProposal grid = Of("circles:8x6:25mm").found.at(0);
  EXPECT_EQ(grid.what, "symmetric grid of 8 x 6 circles");
  EXPECT_EQ(grid.shows, "8 x 6 circles in symmetric pattern");
  EXPECT_EQ(grid.keys, "type: circles\ncolumns: 8\nrows: 6\npattern: symmetric\n");
}

TEST_F(ProposedTarget, IsWhatMostImagesShow) {
  Of("chessboard:9x6:25mm");
  Save(ViewOf(Print(TargetOfWord("chessboard:6x4:25mm")), 0, {640, 480}));
  Save(cv::Mat(480, 640, CV_8UC1, cv::Scalar(128)));
  images_.push_back({"gone", folder_ / "gone.png"});
  const TargetProposals proposals = ProposeTargets(images_, {});
  ASSERT_EQ(proposals.found.size(), 1U);
  EXPECT_EQ(proposals.found[0].word, "chessboard:9x6:SIZE");
  EXPECT_EQ(proposals.found[0].images, 3U);
  EXPECT_EQ(proposals.looked_at, 6U);
}

TEST_F(ProposedTarget, OfTwoThatWhichMoreImagesShowIsFirst) {
  Of("circles:8x6:25mm");
  const cv::Mat chessboard = Print(TargetOfWord("chessboard:9x6:25mm"));
  for (int view = 0; view < 2; ++view) Save(ViewOf(chessboard, view, {640, 480}));
  const TargetProposals proposals = ProposeTargets(images_, {});
  ASSERT_EQ(proposals.found.size(), 2U);
  EXPECT_EQ(proposals.found[0].word, "circles:8x6:SPACING:symmetric");
  EXPECT_EQ(proposals.found[1].word, "chessboard:9x6:SIZE");
}

TEST_F(ProposedTarget, IsNoneInNoise) {
  for (int view = 0; view < 3; ++view) {
    cv::Mat noise(480, 640, CV_8UC1);
    cv::RNG random(static_cast<std::uint64_t>(view) + 1);
    random.fill(noise, cv::RNG::UNIFORM, 0, 256);
    if (view == 2) cv::GaussianBlur(noise, noise, {}, 3);
    Save(noise);
  }
  EXPECT_THAT(ProposeTargets(images_, {}).found, IsEmpty());
}

}  // namespace TEST_FILE
}  // namespace plenocal
