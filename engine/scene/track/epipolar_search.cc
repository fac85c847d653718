// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/track/epipolar_search.h"

#include <array>
#include <cmath>
#include <vector>

#include "calib/camera/rays.h"

namespace plenocal {
namespace {

constexpr int kHalf = 5;  // of the patch, px
constexpr int kSide = 2 * kHalf + 1;
constexpr int kArea = kSide * kSide;
constexpr double kLeastCorrelation = 0.8;
// Another peak of the correlation must be lower by this part of what is missing from 1.
constexpr double kClearlyBest = 1.5;
constexpr int kPeakWidth = 3;  // px

// Grey values of a patch with mean 0 and length 1; nothing at the image's border or without
// texture.
using Patch = std::array<float, kArea>;

std::optional<Patch> PatchAt(const cv::Mat& image, const cv::Point& centre) {
  if (centre.x < kHalf || centre.y < kHalf || centre.x >= image.cols - kHalf ||
      centre.y >= image.rows - kHalf) {
    return std::nullopt;
  }
  constexpr float kLeastTexture = 2;  // standard deviation, grey values
  Patch patch;
  float mean = 0, square = 0;
  size_t i = 0;
  for (int y = -kHalf; y <= kHalf; ++y) {
    const unsigned char* const row = image.ptr(centre.y + y) + centre.x;
    for (int x = -kHalf; x <= kHalf; ++x) mean += patch[i++] = row[x];
  }
  mean /= kArea;
  for (float& value : patch) {
    value -= mean;
    square += value * value;
  }
  if (square < kLeastTexture * kLeastTexture * kArea) return std::nullopt;
  for (float& value : patch) value /= std::sqrt(square);
  return patch;
}

float Correlation(const Patch& a, const Patch& b) {
  float sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

// Pixels of the second image along the curve, from far to near.
std::vector<cv::Point> CurvePixels(const Ray& ray,
                                   const RigidTransform& T_second_first,
                                   const CameraImage& second,
                                   double baselines) {
  constexpr int kMostSteps = 2000;
  const double nearest = baselines * T_second_first.t.norm();
  const BundleCamera& camera = *second.camera;
  std::vector<cv::Point> pixels;
  // Equal steps of the inverse depth are about equal steps in the image.
  const int steps = std::min(kMostSteps, second.image->cols);
  for (int i = 0; i <= steps; ++i) {
    const double inverse = static_cast<double>(i) / steps / nearest;
    const Eigen::Vector3d direction =
        T_second_first.R * (ray.direction + inverse * ray.origin) + inverse * T_second_first.t;
    double u[kMaxObservationSize];
    const double values[kMaxObservationSize] = {};
    if (!Project(camera, values, direction, u)) {
      continue;
    }
    const cv::Point pixel(cvRound(u[0]), cvRound(u[1]));
    if (pixels.empty() || pixel != pixels.back()) pixels.push_back(pixel);
  }
  return pixels;
}

}  // namespace

std::optional<cv::Point2f> SearchEpipolarCurve(const CameraImage& first,
                                               const cv::Point2f& point,
                                               const CameraImage& second,
                                               double nearest) {
  const BundleCamera& camera = *first.camera;
  const double values[kMaxObservationSize] = {point.x, point.y};
  const std::optional<Ray> ray = Unproject(camera, values);
  const std::optional<Patch> wanted = PatchAt(*first.image, {cvRound(point.x), cvRound(point.y)});
  if (!ray || !wanted) return std::nullopt;
  const RigidTransform T_second_first = second.camera->T_camera_rig * camera.T_camera_rig.Inverse();
  float best = -1, other = -1;
  cv::Point at;
  // An error of the calibration shifts the curve by a pixel.
  for (const cv::Point& on_curve : CurvePixels(*ray, T_second_first, second, nearest)) {
    for (int dy = -1; dy <= 1; ++dy) {
      const cv::Point pixel(on_curve.x, on_curve.y + dy);
      const std::optional<Patch> patch = PatchAt(*second.image, pixel);
      if (!patch) continue;
      const float correlation = Correlation(*wanted, *patch);
      const bool same_peak =
          std::abs(pixel.x - at.x) <= kPeakWidth && std::abs(pixel.y - at.y) <= kPeakWidth;
      if (correlation > best) {
        if (!same_peak) other = best;
        best = correlation;
        at = pixel;
      } else if (!same_peak) {
        other = std::max(other, correlation);
      }
    }
  }
  if (best < kLeastCorrelation || 1 - other <= kClearlyBest * (1 - best)) return std::nullopt;
  return cv::Point2f(static_cast<float>(at.x) + point.x - std::round(point.x),
                     static_cast<float>(at.y) + point.y - std::round(point.y));
}

}  // namespace plenocal
