// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/grid_picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace plenocal {
namespace {

constexpr int kHeight = 1200;        // px of the picture
constexpr int kInsets = 3;           // one above the other
constexpr double kInsetPitches = 7;  // micro lenses across an inset
constexpr int kShift = 4;            // fractional bits of OpenCV's drawing functions
// Told apart by most eyes with a colour deficiency: blue, orange, green (BGR).
const std::array<cv::Scalar, 3> kTypeColours{{{230, 160, 0}, {0, 160, 255}, {80, 200, 80}}};
const cv::Scalar kBad{60, 60, 255};

/// The part `view` of the image at `height` px with its grid.
cv::Mat Draw(const cv::Mat& grey, const MicroLensArray& array, const cv::Rect2d& view, int height) {
  const double scale = height / view.height;
  // Pixel p of the image goes to scale (p - view origin + 1/2) - 1/2.
  const double x_0 = scale * (0.5 - view.x) - 0.5, y_0 = scale * (0.5 - view.y) - 0.5;
  const cv::Matx23d map(scale, 0, x_0, 0, scale, y_0);
  cv::Mat picture;
  // Enlarged pixels stay squares; a reduced image is averaged.
  const cv::Size size(static_cast<int>(std::lround(scale * view.width)), height);
  if (scale < 1) {
    cv::resize(grey, picture, size, 0, 0, cv::INTER_AREA);
  } else {
    cv::warpAffine(grey, picture, map, size, cv::INTER_NEAREST, cv::BORDER_CONSTANT);
  }
  cv::cvtColor(picture, picture, cv::COLOR_GRAY2BGR);
  const double radius = 0.5 * array.Pitch() * scale;
  const auto fixed = [](double value) {
    return static_cast<int>(std::lround(value * (1 << kShift)));
  };
  for (const MicroLens& lens : array.lenses) {
    const double x = scale * lens.centre.x() + x_0, y = scale * lens.centre.y() + y_0;
    if (x < -radius || y < -radius || x > size.width + radius || y > size.height + radius) continue;
    const cv::Scalar colour = lens.usable ? kTypeColours[lens.type % kTypeColours.size()] : kBad;
    cv::circle(picture, {fixed(x), fixed(y)}, fixed(radius), colour, 1, cv::LINE_AA, kShift);
    const bool enlarged = radius > 20;
    if (!enlarged && lens.usable) continue;
    const double arm = lens.usable ? radius / 4 : radius;
    const int width = lens.usable ? 1 : 2;
    cv::line(picture,
             {fixed(x - arm), fixed(y)},
             {fixed(x + arm), fixed(y)},
             colour,
             width,
             cv::LINE_AA,
             kShift);
    cv::line(picture,
             {fixed(x), fixed(y - arm)},
             {fixed(x), fixed(y + arm)},
             colour,
             width,
             cv::LINE_AA,
             kShift);
  }
  return picture;
}

}  // namespace

cv::Mat GridPicture(const cv::Mat& white, const MicroLensArray& array) {
  cv::Mat grey;
  double highest = 0;
  cv::minMaxLoc(white, nullptr, &highest);
  white.convertTo(grey, CV_8U, 255 / highest);

  const double width = white.cols, height = white.rows;
  const double side = std::min({kInsetPitches * array.Pitch(), width, height});
  const int inset = kHeight / kInsets;
  const cv::Mat whole = Draw(grey, array, {0, 0, width, height}, kHeight);
  cv::Mat picture(kHeight, whole.cols + inset, CV_8UC3, cv::Scalar::all(0));
  whole.copyTo(picture.colRange(0, whole.cols));
  const std::array<cv::Point2d, kInsets> origins{
      {{0, 0}, {(width - side) / 2, (height - side) / 2}, {width - side, height - side}}};
  for (int k = 0; k < kInsets; ++k) {
    cv::Mat place = picture(cv::Rect(whole.cols, k * inset, inset, inset));
    Draw(grey, array, {origins[k].x, origins[k].y, side, side}, inset).copyTo(place);
    cv::rectangle(place, cv::Rect(0, 0, inset, inset), cv::Scalar::all(255));
  }
  return picture;
}

}  // namespace plenocal
