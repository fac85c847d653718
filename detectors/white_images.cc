// SPDX-License-Identifier: Apache-2.0
#include "detectors/white_images.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <mutex>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>

#include "calib/error.h"
#include "calib/median.h"
#include "calib/parallel.h"
#include "detectors/image.h"

namespace plenocal {
namespace {

/// Standard deviation of a normal distribution / median of absolute deviations.
constexpr double kSigmaPerMad = 1.4826;
/// An outlier lies beyond this many robust standard deviations of the images.
constexpr double kOutlier = 6;
/// Lamps flicker by this much (relative, one sigma), so smaller differences are never an outlier's.
constexpr double kFlicker = 0.01;
/// More clipped pixels than this can be no stray highlights: the attenuation would be wrong there.
constexpr double kMaxSaturated = 0.01;
/// With fewer grey levels than this on average rounding alone (1 / sqrt(12) of a level) makes more
/// than 3 % error.
constexpr double kFewestLevels = 8;
/// Shading is compared on a grid of this many cells a side.
constexpr int kCells = 16;
/// Where the shading of the images differs by more than this (robust, relative), no two show the
/// same field.
constexpr double kSameField = 0.05;

/// One image without its pixels.
struct Look {
  ImageSize size{};
  std::string unreadable;
  int depth = CV_8U;
  unsigned all_bits = 0;  ///< of all pixels: shows in which bits a sensor's values lie
  double largest = 0;
  double level = 0;
  double black = 0;
  double at_largest = 0;  ///< share of pixels at the largest value
  cv::Mat shading;        ///< kCells x kCells, CV_64F, mean 1
};

cv::Mat ToGray(const cv::Mat& image) {
  if (image.channels() == 1) return image;
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

template <typename T>
unsigned AllBits(const cv::Mat& image) {
  unsigned bits = 0;
  for (int y = 0; y < image.rows; ++y) {
    const T* row = image.ptr<T>(y);
    for (int x = 0; x < image.cols * image.channels(); ++x) bits |= row[x];
  }
  return bits;
}

Look LookAt(const cv::Mat& image, const cv::Mat& gray) {
  Look look;
  look.size = {gray.cols, gray.rows};
  look.depth = gray.depth();
  look.all_bits =
      gray.depth() == CV_8U ? AllBits<std::uint8_t>(image) : AllBits<std::uint16_t>(image);
  const cv::Mat values = image.reshape(1);  // a colour is clipped when one of its channels is
  cv::minMaxLoc(values, nullptr, &look.largest);
  look.at_largest = static_cast<double>(cv::countNonZero(values == look.largest)) /
                    static_cast<double>(gray.total());
  look.black = static_cast<double>(cv::countNonZero(gray == 0)) / static_cast<double>(gray.total());
  look.level = cv::mean(gray)[0];
  cv::Mat exact, cells;
  gray.convertTo(exact, CV_32F);
  cv::resize(exact, cells, {kCells, kCells}, 0, 0, cv::INTER_AREA);
  cells.convertTo(look.shading, CV_64F, 1 / std::max(look.level, 1e-9));
  return look;
}

/// Full scale of a set of images: all ones in the bits that its values use (12 bits may lie low or
/// high in 16).
double FullScale(const std::vector<Look>& looks) {
  unsigned bits = 0;
  bool deep = false;
  for (const Look& look : looks) {
    bits |= look.all_bits;
    deep = deep || look.depth == CV_16U;
  }
  if (!deep) return 255;
  if (bits == 0) return 65535;
  const int unused = std::countr_zero(bits);
  return static_cast<double>((std::bit_ceil((bits >> unused) + 1) - 1) << unused);
}

/// Root mean square of the difference of two shadings.
double ShadingDifference(const cv::Mat& a, const cv::Mat& b) {
  return cv::norm(a, b, cv::NORM_L2) / kCells;
}

cv::Mat MedianShading(const std::vector<const Look*>& looks) {
  cv::Mat median(kCells, kCells, CV_64F);
  for (int y = 0; y < kCells; ++y) {
    for (int x = 0; x < kCells; ++x) {
      std::vector<double> values;
      values.reserve(looks.size());
      for (const Look* look : looks) values.push_back(look->shading.at<double>(y, x));
      median.at<double>(y, x) = Median(std::move(values));
    }
  }
  return median;
}

/// Odd part of the shading about the middle: largest difference between opposite sides of a plane
/// through it.
double Unevenness(const cv::Mat& mean) {
  cv::Mat cells;
  cv::resize(mean, cells, {kCells, kCells}, 0, 0, cv::INTER_AREA);
  double x_slope = 0, y_slope = 0, squares = 0, sum = 0;
  for (int y = 0; y < kCells; ++y) {
    for (int x = 0; x < kCells; ++x) {
      const double dx = (x + 0.5) / kCells - 0.5, dy = (y + 0.5) / kCells - 0.5;
      x_slope += dx * cells.at<float>(y, x);
      y_slope += dy * cells.at<float>(y, x);
      squares += dx * dx;
      sum += cells.at<float>(y, x);
    }
  }
  const double level = sum / (kCells * kCells);
  return level > 0 ? std::hypot(x_slope, y_slope) / squares / level : 0;
}

/// Why an image is no good by itself; empty when it is.
std::string Defect(const Look& look, double full_scale) {
  if (look.largest >= full_scale && look.at_largest > kMaxSaturated) {
    return fmt::format(
        "is saturated: {:.1f} % of its pixels are at full scale ({:.0f}); shorten the exposure",
        100 * look.at_largest,
        full_scale);
  }
  const double step = look.all_bits == 0 ? 1 : 1 << std::countr_zero(look.all_bits);
  if (look.level < kFewestLevels * step) {
    return fmt::format("is black: its mean is {:.1f} of {:.0f} grey values; expose longer",
                       look.level,
                       full_scale);
  }
  return {};
}

}  // namespace

WhiteImages AverageWhiteImages(const std::vector<FrameImage>& images, int threads) {
  WhiteImages white;
  std::vector<Look> looks(images.size());
  cv::Mat sum;
  std::mutex sum_mutex;
  // Images are summed as they are read, so that memory does not grow with their number; what only
  // all together show to be outliers is read again and taken off.
  const auto read = [&](size_t i, Look* look, double sign) {
    const cv::Mat image = ReadImage(images[i].path);
    const cv::Mat gray = ToGray(image);
    if (look != nullptr) *look = LookAt(image, gray);
    cv::Mat exact;
    gray.convertTo(exact, CV_32F, sign);
    const std::lock_guard lock(sum_mutex);
    if (sum.empty()) sum = cv::Mat::zeros(gray.size(), CV_32F);
    if (sum.size() == gray.size()) sum += exact;
  };
  ParallelFor(images.size(), threads, [&](size_t i) {
    try {
      read(i, &looks[i], 1);
    } catch (const Error& error) {
      looks[i].unreadable = error.what();
    }
  });

  const auto path = [&](size_t i) { return images[i].path.string(); };
  std::vector<size_t> readable;
  for (size_t i = 0; i < looks.size(); ++i) {
    if (looks[i].unreadable.empty()) {
      readable.push_back(i);
      continue;
    }
    white.left_out.push_back({path(i), WithoutPath(looks[i].unreadable, path(i))});
  }
  if (readable.empty()) {
    throw Error(ErrorKind::kJob,
                fmt::format("no white image can be read; the first: {}", looks[0].unreadable));
  }
  for (const size_t i : readable) {
    const Look &first = looks[readable[0]], &look = looks[i];
    if (look.size == first.size) continue;
    throw Error(
        ErrorKind::kInput,
        fmt::format("{}: is {} x {} pixels, while {} is {} x {}; white images of one camera "
                    "have one size",
                    path(i),
                    look.size[0],
                    look.size[1],
                    path(readable[0]),
                    first.size[0],
                    first.size[1]));
  }

  white.full_scale = FullScale(looks);
  std::vector<size_t> kept;
  const auto leave_out = [&](size_t i, const std::string& reason) {
    white.left_out.push_back({path(i), reason});
    read(i, nullptr, -1);
  };
  for (const size_t i : readable) {
    const std::string defect = Defect(looks[i], white.full_scale);
    if (defect.empty()) {
      kept.push_back(i);
    } else {
      leave_out(i, defect);
    }
  }
  if (kept.empty()) {
    throw Error(ErrorKind::kJob,
                fmt::format("no white image is of use; the first: {}: {}",
                            white.left_out[0].where,
                            white.left_out[0].reason));
  }

  // Level and shading against the median of all.
  std::vector<const Look*> good;
  std::vector<double> levels;
  for (const size_t i : kept) {
    good.push_back(&looks[i]);
    levels.push_back(looks[i].level);
  }
  const double level = Median(levels);
  const cv::Mat shading = MedianShading(good);
  std::vector<double> level_errors, shading_errors;
  for (const Look* look : good) {
    level_errors.push_back(std::abs(look->level / level - 1));
    shading_errors.push_back(ShadingDifference(look->shading, shading));
  }
  if (Median(shading_errors) > kSameField) {
    throw Error(
        ErrorKind::kJob,
        fmt::format("{} and the other white images differ from each other by {:.0f} % (median): "
                    "they show a scene or a light that changes; record an even white field",
                    path(kept[0]),
                    100 * Median(shading_errors)));
  }
  const double level_sigma = std::max(kFlicker, kSigmaPerMad * Median(level_errors));
  const double shading_sigma = std::max(kFlicker, kSigmaPerMad * Median(shading_errors));
  for (size_t k = 0; k < kept.size(); ++k) {
    const Look& look = *good[k];
    if (level_errors[k] > kOutlier * level_sigma) {
      leave_out(kept[k],
                fmt::format("its brightness is {:.2f} of that of the other white images",
                            look.level / level));
    } else if (shading_errors[k] > kOutlier * shading_sigma) {
      leave_out(kept[k],
                fmt::format("its shading differs by {:.0f} % from that of the other white images; "
                            "does it show a scene?",
                            100 * shading_errors[k]));
    } else {
      ++white.used;
      white.saturated += look.largest >= white.full_scale ? look.at_largest : 0;
      white.black += look.black;
    }
  }
  white.saturated /= static_cast<double>(white.used);
  white.black /= static_cast<double>(white.used);
  white.mean = sum / static_cast<double>(white.used);
  white.level = cv::mean(white.mean)[0];
  white.unevenness = Unevenness(white.mean);
  return white;
}

}  // namespace plenocal
