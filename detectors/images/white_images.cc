// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/white_images.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <mutex>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>

#include "calib/base/format_error.h"
#include "calib/base/parallel.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"
#include "detectors/images/image.h"

namespace plenocal {
namespace {

/// An outlier lies beyond this many robust standard deviations of the images: of 100 normal ones
/// none does, and scenes or switched-off lamps lie far beyond.
constexpr double kOutlier = 6;
/// Lamps flicker by this much (relative, one sigma), so smaller differences are never an outlier's.
constexpr double kFlicker = 0.01;
/// Share of clipped pixels beyond which they are no stray highlights: the attenuation would be
/// wrong there.
constexpr double kMaxSaturated = 0.01;
/// With fewer grey levels than this on average rounding alone (1 / sqrt(12) of a level) makes more
/// than 3 % error.
constexpr double kFewestLevels = 8;
/// Shading is compared on a grid of this many cells a side.
constexpr int kCells = 16;
/// Images whose shading differs by more than this (median, relative) show no common field.
constexpr double kSameField = 0.05;
/// Bytes of decoded images that are kept: a dozen of four megapixels.
constexpr size_t kMostDecoded = size_t{64} << 20;

/// One image without its pixels.
struct Summary {
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

template <typename T>
unsigned AllBits(const cv::Mat& image) {
  unsigned bits = 0;
  for (int y = 0; y < image.rows; ++y) {
    const T* row = image.ptr<T>(y);
    for (int x = 0; x < image.cols * image.channels(); ++x) bits |= row[x];
  }
  return bits;
}

Summary Summarise(const cv::Mat& image, const cv::Mat& gray) {
  Summary summary;
  summary.size = {gray.cols, gray.rows};
  summary.depth = gray.depth();
  summary.all_bits =
      gray.depth() == CV_8U ? AllBits<std::uint8_t>(image) : AllBits<std::uint16_t>(image);
  const cv::Mat values = image.reshape(1);  // a colour is clipped when one of its channels is
  cv::minMaxLoc(values, nullptr, &summary.largest);
  summary.at_largest = static_cast<double>(cv::countNonZero(values == summary.largest)) /
                       static_cast<double>(gray.total());
  summary.black =
      static_cast<double>(cv::countNonZero(gray == 0)) / static_cast<double>(gray.total());
  summary.level = cv::mean(gray)[0];
  cv::Mat exact, cells;
  gray.convertTo(exact, CV_32F);
  cv::resize(exact, cells, {kCells, kCells}, 0, 0, cv::INTER_AREA);
  cells.convertTo(summary.shading, CV_64F, 1 / std::max(summary.level, 1e-9));
  return summary;
}

/// Full scale of a set of images: all ones in the bits that its values use (12 bits may lie low or
/// high in 16).
double FullScale(const std::vector<Summary>& summaries) {
  unsigned bits = 0;
  bool deep = false;
  for (const Summary& summary : summaries) {
    bits |= summary.all_bits;
    deep = deep || summary.depth == CV_16U;
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

cv::Mat MedianShading(const std::vector<const Summary*>& summaries) {
  cv::Mat median(kCells, kCells, CV_64F);
  for (int y = 0; y < kCells; ++y) {
    for (int x = 0; x < kCells; ++x) {
      std::vector<double> values;
      values.reserve(summaries.size());
      for (const Summary* summary : summaries) values.push_back(summary->shading.at<double>(y, x));
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

/// Reason to leave an image out, judged by itself; empty: there is none.
std::string Defect(const Summary& summary, double full_scale) {
  if (summary.largest >= full_scale && summary.at_largest > kMaxSaturated) {
    return fmt::format(
        "is saturated: {:.1f} % of its pixels are at full scale ({:.0f}); shorten the exposure",
        100 * summary.at_largest,
        full_scale);
  }
  const double step = summary.all_bits == 0 ? 1 : 1 << std::countr_zero(summary.all_bits);
  if (summary.level < kFewestLevels * step) {
    return fmt::format("is black: its mean is {:.1f} of {:.0f} grey values; expose longer",
                       summary.level,
                       full_scale);
  }
  return {};
}

/// White images on their way to their mean. They are summed as they are read, so that memory does
/// not grow with their number; outliers, which only all images together reveal, are subtracted.
class WhiteSum {
 public:
  WhiteSum(const std::vector<FrameImage>& images, int threads);

  /// Throws `Error` when images are of different sizes or none can be read.
  void CheckSizes() const;
  void LeaveOutDefective();
  /// Leaves out images whose level or shading differs from the median of all. Throws `Error` when
  /// the median difference shows that they have no field in common.
  void LeaveOutOutliers();
  WhiteImages Mean() &&;

 private:
  /// Adds an image to the sum and keeps it as long as there is space.
  void Add(size_t i, const cv::Mat& gray);
  /// Takes an image off the sum.
  void LeaveOut(size_t i, const std::string& reason);
  [[nodiscard]] std::string Path(size_t i) const { return images_[i].path.string(); }

  const std::vector<FrameImage>& images_;
  std::vector<Summary> summaries_;
  std::mutex sum_mutex_;
  cv::Mat sum_;
  size_t decoded_bytes_ = 0;
  std::vector<size_t> used_;  ///< images in the sum
  WhiteImages white_;
};

WhiteSum::WhiteSum(const std::vector<FrameImage>& images, int threads)
    : images_(images), summaries_(images.size()) {
  ParallelFor(images.size(), threads, [&](size_t i) {
    try {
      const cv::Mat image = ReadImage(images[i]);
      const cv::Mat gray = ToGray(image);
      summaries_[i] = Summarise(image, gray);
      Add(i, gray);
    } catch (const Error& error) {
      summaries_[i].unreadable = error.what();
    }
  });
  for (size_t i = 0; i < images.size(); ++i) {
    const std::string& defect = summaries_[i].unreadable;
    if (defect.empty()) {
      used_.push_back(i);
    } else {
      white_.left_out.push_back({Path(i), WithoutPath(defect, Path(i))});
    }
  }
}

void WhiteSum::Add(size_t i, const cv::Mat& gray) {
  const std::lock_guard lock(sum_mutex_);
  if (sum_.empty()) sum_ = cv::Mat::zeros(gray.size(), CV_64F);
  if (sum_.size() != gray.size()) return;
  cv::accumulate(gray, sum_);
  const size_t bytes = gray.total() * gray.elemSize();
  if (decoded_bytes_ + bytes > kMostDecoded) return;
  decoded_bytes_ += bytes;
  white_.decoded[i] = gray;
}

void WhiteSum::LeaveOut(size_t i, const std::string& reason) {
  white_.left_out.push_back({Path(i), reason});
  cv::subtract(sum_, white_.Gray(images_, i), sum_, cv::noArray(), CV_64F);
  white_.decoded.erase(i);
}

void WhiteSum::CheckSizes() const {
  if (used_.empty()) {
    throw JobError("no white image can be read; the first: {}", summaries_[0].unreadable);
  }
  const ImageSize& expected = summaries_[used_[0]].size;
  for (const size_t i : used_) {
    const ImageSize& size = summaries_[i].size;
    if (size == expected) continue;
    throw InputError(
        "{}: is {} x {} pixels, while {} is {} x {}; white images of one camera have "
        "one size",
        Path(i),
        size[0],
        size[1],
        Path(used_[0]),
        expected[0],
        expected[1]);
  }
}

void WhiteSum::LeaveOutDefective() {
  white_.full_scale = FullScale(summaries_);
  std::vector<size_t> kept;
  for (const size_t i : used_) {
    const std::string defect = Defect(summaries_[i], white_.full_scale);
    if (defect.empty()) {
      kept.push_back(i);
    } else {
      LeaveOut(i, defect);
    }
  }
  used_ = std::move(kept);
  if (!used_.empty()) return;
  throw JobError("no white image is of use; the first: {}: {}",
                 white_.left_out[0].where,
                 white_.left_out[0].reason);
}

void WhiteSum::LeaveOutOutliers() {
  std::vector<const Summary*> summaries;
  std::vector<double> levels;
  for (const size_t i : used_) {
    summaries.push_back(&summaries_[i]);
    levels.push_back(summaries_[i].level);
  }
  const double level = Median(levels);
  const cv::Mat shading = MedianShading(summaries);
  std::vector<double> level_errors, shading_errors;
  for (const Summary* summary : summaries) {
    level_errors.push_back(std::abs(summary->level / level - 1));
    shading_errors.push_back(ShadingDifference(summary->shading, shading));
  }
  if (Median(shading_errors) > kSameField) {
    throw JobError(
        "{} and the other white images differ from each other by {:.0f} % (median): "
        "they show a scene or a light that changes; record an even white field",
        Path(used_[0]),
        100 * Median(shading_errors));
  }
  const double level_sigma = std::max(kFlicker, kSigmaPerMad * Median(level_errors));
  const double shading_sigma = std::max(kFlicker, kSigmaPerMad * Median(shading_errors));
  std::vector<size_t> kept;
  for (size_t k = 0; k < used_.size(); ++k) {
    if (level_errors[k] > kOutlier * level_sigma) {
      LeaveOut(used_[k],
               fmt::format("its brightness is {:.2f} of that of the other white images",
                           summaries[k]->level / level));
    } else if (shading_errors[k] > kOutlier * shading_sigma) {
      LeaveOut(used_[k],
               fmt::format("its shading differs by {:.0f} % from that of the other white images; "
                           "does it show a scene?",
                           100 * shading_errors[k]));
    } else {
      kept.push_back(used_[k]);
    }
  }
  used_ = std::move(kept);
}

WhiteImages WhiteSum::Mean() && {
  for (const size_t i : used_) {
    const Summary& summary = summaries_[i];
    white_.saturated += summary.largest >= white_.full_scale ? summary.at_largest : 0;
    white_.black += summary.black;
  }
  white_.members = used_;
  const auto count = static_cast<double>(used_.size());
  white_.saturated /= count;
  white_.black /= count;
  cv::Mat(sum_ / count).convertTo(white_.mean, CV_32F);
  white_.level = cv::mean(white_.mean)[0];
  white_.unevenness = Unevenness(white_.mean);
  return std::move(white_);
}

}  // namespace

cv::Mat WhiteImages::Gray(const std::vector<FrameImage>& images, size_t i) const {
  const auto found = decoded.find(i);
  return found != decoded.end() ? found->second : ToGray(ReadImage(images[i]));
}

WhiteImages AverageWhiteImages(const std::vector<FrameImage>& images, int threads) {
  WhiteSum sum(images, threads);
  sum.CheckSizes();
  sum.LeaveOutDefective();
  sum.LeaveOutOutliers();
  return std::move(sum).Mean();
}

}  // namespace plenocal
