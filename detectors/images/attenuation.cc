// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/attenuation.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "calib/base/format_error.h"

namespace plenocal {
namespace {

/// Attenuation that is still written: darker pixels, whose inverse is noise, get this.
constexpr double kDarkest = 1e-4;
/// Of the larger image side: no lens' fall-off changes within it, and some hundred pixels average
/// noise out.
constexpr double kSmoothing = 0.01;

/// The four planes of a 2 x 2 raster, row by row.
struct Planes {
  Eigen::Array4d mean;  ///< relative to their mean; zeros of a black image
  double sigma = 0;     ///< standard error of the difference of two
};
constexpr double kSure = 5;        // standard errors
constexpr double kDiffers = 0.03;  // more than an array whose pitch is whole pixels does to planes

Planes MeasurePlanes(const cv::Mat& white) {
  constexpr int kTiles = 4;  // a side
  Eigen::Array4d sum = Eigen::Array4d::Zero(), squares = Eigen::Array4d::Zero();
  for (int tile = 0; tile < kTiles * kTiles; ++tile) {
    const auto edge = [&](int length, int k) { return length / 2 * k / kTiles * 2; };
    const int y0 = edge(white.rows, tile / kTiles), y1 = edge(white.rows, tile / kTiles + 1);
    const int x0 = edge(white.cols, tile % kTiles), x1 = edge(white.cols, tile % kTiles + 1);
    Eigen::Array4d mean = Eigen::Array4d::Zero();
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) mean[y % 2 * 2 + x % 2] += white.at<float>(y, x);
    }
    if (!(mean.mean() > 0)) return {Eigen::Array4d::Zero(), 0};
    mean /= mean.mean();
    sum += mean;
    squares += mean.square();
  }
  constexpr int kCount = kTiles * kTiles;
  const Eigen::Array4d mean = sum / kCount;
  const Eigen::Array4d variance = (squares / kCount - mean.square()).max(0) / (kCount - 1);
  return {mean, std::sqrt(2 * variance.maxCoeff())};
}

}  // namespace

cv::Mat internal::ForBayerPlanes(const cv::Mat& mosaic,
                                 const std::function<cv::Mat(const cv::Mat&)>& change) {
  cv::Mat out(mosaic.size(), CV_32F);
  for (int y = 0; y < 2; ++y) {
    for (int x = 0; x < 2; ++x) {
      cv::Mat plane((mosaic.rows - y + 1) / 2, (mosaic.cols - x + 1) / 2, CV_32F);
      for (int r = 0; r < plane.rows; ++r) {
        for (int c = 0; c < plane.cols; ++c) {
          plane.at<float>(r, c) = mosaic.at<float>(2 * r + y, 2 * c + x);
        }
      }
      plane = change(plane);
      for (int r = 0; r < plane.rows; ++r) {
        for (int c = 0; c < plane.cols; ++c) {
          out.at<float>(2 * r + y, 2 * c + x) = plane.at<float>(r, c);
        }
      }
    }
  }
  return out;
}

cv::Mat internal::LimitAttenuation(const cv::Mat& attenuation) {
  cv::Mat limited;
  cv::min(attenuation, 1.0, limited);
  cv::max(limited, kDarkest, limited);
  return limited;
}

cv::Mat LargeScaleMean(const cv::Mat& image) {
  // Some ten independent places along a side: coarser than any micro image, as fine as shading
  // needs. Computed on a small image, as a wide filter on the full one would take seconds.
  constexpr int kCells = 64;
  constexpr double kBlur = kCells / 12.0;               // cells
  constexpr double kLeast = 1e-6, kLeastOfMean = 1e-3;  // keep ratios to the mean finite
  const cv::Size small(std::min(kCells, image.cols), std::min(kCells, image.rows));
  cv::Mat coarse, smooth, mean;
  cv::resize(image, coarse, small, 0, 0, cv::INTER_AREA);
  cv::GaussianBlur(coarse, smooth, {}, kBlur, 0, cv::BORDER_REFLECT);
  cv::resize(smooth, mean, image.size(), 0, 0, cv::INTER_LINEAR);
  cv::max(mean, std::max(kLeast, kLeastOfMean * cv::mean(image)[0]), mean);
  return mean;
}

void CheckEvenField(const cv::Mat& white) {
  // Mean brightness of small cells against its large-scale mean, where light falls at all.
  constexpr int kCells = 32;
  constexpr double kLit = 0.3;  // of the brightest cell: darker corners are beyond the image circle
  // Fall-off bends by 1 to 2 % between the two scales (5 % in the corners); a fifth of the field
  // leaves room for corners.
  constexpr double kEven = 0.05, kQuantile = 0.8;
  cv::Mat large, fine;
  cv::resize(LargeScaleMean(white), large, {kCells, kCells}, 0, 0, cv::INTER_AREA);
  cv::resize(white, fine, {kCells, kCells}, 0, 0, cv::INTER_AREA);
  double highest = 0;
  cv::minMaxLoc(large, nullptr, &highest);
  std::vector<double> steps;
  for (int y = 0; y < kCells; ++y) {
    for (int x = 0; x < kCells; ++x) {
      const double level = large.at<float>(y, x);
      if (level >= kLit * highest) steps.push_back(std::abs(fine.at<float>(y, x) / level - 1));
    }
  }
  const auto quantile =
      steps.begin() + static_cast<std::ptrdiff_t>(kQuantile * static_cast<double>(steps.size()));
  std::nth_element(steps.begin(), quantile, steps.end());
  if (*quantile <= kEven) return;
  throw JobError(
      "the white images show a scene: a fifth of the field differs by more than {:.0f} % from "
      "its surroundings; record an even white field",
      100 * *quantile);
}

cv::Mat SmoothAttenuation(const cv::Mat& white, std::optional<BayerOrder> bayer) {
  const auto attenuation = [&](const cv::Mat& plane) {
    cv::Mat smooth;
    cv::GaussianBlur(plane, smooth, {}, kSmoothing * std::max(plane.cols, plane.rows));
    double highest = 0;
    cv::minMaxLoc(smooth, nullptr, &highest);
    return cv::Mat(smooth / highest);
  };
  return internal::LimitAttenuation(bayer ? internal::ForBayerPlanes(white, attenuation)
                                          : attenuation(white));
}

double PlaneDifference(const cv::Mat& white) {
  const auto [mean, sigma] = MeasurePlanes(white);
  const double difference = mean.maxCoeff() - mean.minCoeff();
  return difference > kDiffers && difference > kSure * sigma ? difference : 0;
}

bool PlanesAgree(const cv::Mat& white) {
  const auto [mean, sigma] = MeasurePlanes(white);
  return mean.mean() > 0 && mean.maxCoeff() - mean.minCoeff() + kSure * sigma < kDiffers;
}

double GreenDifference(const cv::Mat& white, BayerOrder order) {
  constexpr double kClearly = 3;
  const auto [mean, sigma] = MeasurePlanes(white);
  const bool green_first = BayerColour(order, 0, 0) == 'G';
  const double first = std::abs(mean[0] - mean[3]), second = std::abs(mean[1] - mean[2]);
  const double green = green_first ? first : second, other = green_first ? second : first;
  return green > kDiffers && green > kSure * sigma && green > kClearly * other ? green : 0;
}

}  // namespace plenocal
