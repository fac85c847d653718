// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/views/sub_aperture.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>

namespace plenocal::internal {
namespace TEST_FILE {

constexpr ImageSize kSize{240, 200};
constexpr double kPitch = 16;
constexpr double kContrast = 35;  // root mean square of the scene below

MicroLensArray Array(double angle) {
  MicroLensArray array;
  array.image_size = kSize;
  array.e_column = Eigen::Rotation2Dd(0.1) * Eigen::Vector2d(kPitch, 0);
  array.e_row = Eigen::Rotation2Dd(angle) * array.e_column;
  for (int row = -20; row <= 20; ++row) {
    for (int column = -30; column <= 30; ++column) {
      const Eigen::Vector2d c =
          Eigen::Vector2d(120.3, 99.8) + column * array.e_column + row * array.e_row;
      if (IsInside(c, kSize)) array.lenses.push_back({.row = row, .column = column, .centre = c});
    }
  }
  return array;
}

// A smooth virtual image.
double Scene(const Eigen::Vector2d& q) {
  return 100 + 40 * std::sin(q.x() / 14) + 30 * std::cos(q.y() / 17);
}

// Every pixel of a raw image shows the scene at virtual depth v, through the nearest micro lens.
cv::Mat Raw(const MicroLensArray& array, double v) {
  cv::Mat raw(kSize[1], kSize[0], CV_32F, cv::Scalar(0));
  for (int y = 0; y < raw.rows; ++y) {
    for (int x = 0; x < raw.cols; ++x) {
      const Eigen::Vector2d at(x, y);
      const MicroLens& lens = *std::ranges::min_element(
          array.lenses, {}, [&](const MicroLens& each) { return (each.centre - at).norm(); });
      raw.at<float>(y, x) = static_cast<float>(Scene(lens.centre + v * (at - lens.centre)));
    }
  }
  return raw;
}

LensPatches Patches(const MicroLensArray& array, double v) {
  const cv::Mat white(kSize[1], kSize[0], CV_32F, cv::Scalar(1));
  return CutPatches(Raw(array, v), white, array, std::nullopt, 1);
}

// Root mean square difference from `expected` in the middle of an image.
template <typename Expected>
double Error(const cv::Mat& image, const ViewGrid& grid, const Expected& expected) {
  double sum = 0, count = 0;
  for (int y = static_cast<int>(60 / grid.step); y * grid.step < kSize[1] - 60; ++y) {
    for (int x = static_cast<int>(60 / grid.step); x * grid.step < kSize[0] - 60; ++x) {
      const Eigen::Vector2d at(x * grid.step, y * grid.step);
      sum += std::pow(image.at<float>(y, x) - expected(at), 2);
      ++count;
    }
  }
  return std::sqrt(sum / count);
}

TEST(SubApertureImage, ShowsOnePlaceOfAllMicroImages) {
  constexpr double kDepth = 0.6;
  for (const double angle : {std::numbers::pi / 3, std::numbers::pi / 2}) {
    const MicroLensArray array = Array(angle);
    const LensPatches patches = Patches(array, kDepth);
    const ViewGrid grid = MakeViewGrid(kSize, 2);
    for (const Eigen::Vector2d& offset : {Eigen::Vector2d(0, 0), {3, -2}, {-4.5, 1.5}}) {
      const cv::Mat view = SubApertureImage(patches, MicroLensIndex(array), offset, grid);
      // Linear interpolation over a pitch of waves of this length: at most (pitch / 2)^2 / 2 times
      // their second derivatives.
      const double tolerance = 8 * 8 / 2.0 * (40 / (14.0 * 14) + 30 / (17.0 * 17));
      EXPECT_LT(
          Error(view, grid, [&](const Eigen::Vector2d& at) { return Scene(at + kDepth * offset); }),
          tolerance);
    }
  }
}

TEST(RefocusedImage, IsSharpAtItsDepthOnly) {
  for (const double v : {3.0, -3.0, 0.5}) {
    const MicroLensArray array = Array(std::numbers::pi / 3);
    const LensPatches patches = Patches(array, v);
    const ViewGrid grid = MakeViewGrid(kSize, 1);
    const double right = Error(RefocusedImage(patches, array, v, grid), grid, Scene);
    const double wrong = Error(RefocusedImage(patches, array, v + 3, grid), grid, Scene);
    // Below v = 1 gaps between the micro images are interpolated.
    EXPECT_LT(right, (std::abs(v) < 1 ? 0.2 : 0.1) * kContrast) << v;
    EXPECT_GT(wrong, 1.5 * right) << v;
  }
}

// Half of the raw image has no micro lens.
TEST(RefocusedImage, IsUnknownWhereNothingFalls) {
  MicroLensArray array = Array(std::numbers::pi / 3);
  std::erase_if(array.lenses, [](const MicroLens& lens) { return lens.centre.x() > 120; });
  const ViewGrid grid = MakeViewGrid(kSize, 1);
  const LensPatches patches = Patches(array, 1);
  const cv::Mat refocused = RefocusedImage(patches, array, 1, grid),
                view = SubApertureImage(patches, MicroLensIndex(array), {0, 0}, grid);
  for (const cv::Mat& image : {refocused, view}) {
    const auto known = [&](int from, int to) {
      const cv::Mat part = image(cv::Range(60, kSize[1] - 60), cv::Range(from, to));
      return cv::mean(part == part)[0] / 255;  // NaN != NaN
    };
    EXPECT_GT(known(60, 90), 0.7);  // but for gaps between micro images
    EXPECT_EQ(known(145, kSize[0]), 0);
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
