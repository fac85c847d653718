// SPDX-License-Identifier: Apache-2.0
//
// Images of a chessboard for runs of the program.
#pragma once

#include <fmt/format.h>

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "tests/apps/workspace.h"

namespace plenocal::testing {

inline constexpr int kColumns = 8, kRows = 5;  // inner corners
inline constexpr double kSquare = 0.03;
inline constexpr double kFocal = 600;
inline constexpr int kImages = 8;

/// A chessboard before a pinhole camera, one of several tilted views.
inline cv::Mat ChessboardView(int view, cv::Size size = {640, 480}) {
  constexpr int kTexel = 40;  // texture pixels a square
  constexpr int kMargin = 2;  // squares: the outer ones and a white border
  cv::Mat board((kRows + 2 * kMargin - 1) * kTexel, (kColumns + 2 * kMargin - 1) * kTexel, CV_8UC1);
  for (int y = 0; y < board.rows; ++y) {
    for (int x = 0; x < board.cols; ++x) {
      const int column = x / kTexel, row = y / kTexel;
      const bool inside = column >= 1 && column <= kColumns + 1 && row >= 1 && row <= kRows + 1;
      board.at<uchar>(y, x) = inside && (column + row) % 2 == 0 ? 20 : 230;
    }
  }
  const double angle = 0.8 * view;
  cv::Mat R;
  cv::Rodrigues(cv::Vec3d(0.5 * std::cos(angle), 0.5 * std::sin(angle), 0.1 * (view % 3)), R);
  const cv::Matx33d K(kFocal, 0, size.width / 2.0, 0, kFocal, size.height / 2.0, 0, 0, 1);
  const cv::Matx33d rotation(R);
  const cv::Vec3d centre =
      rotation * cv::Vec3d((kColumns - 1) * kSquare / 2, (kRows - 1) * kSquare / 2, 0);
  const cv::Vec3d t = cv::Vec3d(0.03 * std::sin(view), 0.02 * std::cos(2 * view), 0.45) - centre;
  const cv::Matx33d pose(rotation(0, 0),
                         rotation(0, 1),
                         t[0],
                         rotation(1, 0),
                         rotation(1, 1),
                         t[1],
                         rotation(2, 0),
                         rotation(2, 1),
                         t[2]);
  const double scale = kSquare / kTexel;
  const double shift = kSquare * (0.5 / kTexel - kMargin);
  const cv::Matx33d board_from_texel(scale, 0, shift, 0, scale, shift, 0, 0, 1);
  cv::Mat image;
  cv::warpPerspective(board,
                      image,
                      K * pose * board_from_texel,
                      size,
                      cv::INTER_LINEAR,
                      cv::BORDER_CONSTANT,
                      cv::Scalar(230));
  cv::GaussianBlur(image, image, {5, 5}, 0.8);
  return image;
}

/// A session of one camera with `kImages` views, images/00.png and so on.
class Images : public Workspace {
 protected:
  Images() {
    Write("target.yaml",
          fmt::format("plenocal: 1\ntype: chessboard\ncolumns: {}\nrows: {}\nsquare: {}\n",
                      kColumns,
                      kRows,
                      kSquare));
    WriteSession({"images/*.png"});
    for (int i = 0; i < kImages; ++i) Save(fmt::format("images/{:02}.png", i), ChessboardView(i));
  }

  void WriteSession(const std::vector<std::string>& globs) const {
    std::string text = "plenocal: 1\ntarget: target.yaml\ncameras:\n";
    for (std::size_t i = 0; i < globs.size(); ++i) {
      text += fmt::format("  cam{}:\n    model: pinhole-radial3\n    images: {}\n", i, globs[i]);
    }
    Write("session.yaml", text);
  }

  void Save(const std::string& name, const cv::Mat& image) const {
    std::filesystem::create_directories(Path(name).parent_path());
    ASSERT_TRUE(cv::imwrite(Path(name).string(), image));
  }

  // The bad image costs itself and nothing else, and the message names it once.
  void ExpectLeftOut(const std::string& name, const std::vector<std::string>& parts) const {
    const Outcome outcome = Calibrate();
    std::string line;
    for (const std::string& candidate : Lines(outcome.err)) {
      if (candidate.find(name) != std::string::npos) line = candidate;
    }
    EXPECT_THAT(line, ::testing::HasSubstr("left out"));
    EXPECT_EQ(line.find(name), line.rfind(name)) << line;
    for (const std::string& part : parts) EXPECT_THAT(line, ::testing::HasSubstr(part));
    EXPECT_EQ(Result()["frames"].as<int>(), kImages);
    EXPECT_THAT(Read("out/calibration.yaml"), ::testing::HasSubstr(name));
    EXPECT_TRUE(std::filesystem::exists(Path(name)));
  }
};

}  // namespace plenocal::testing
