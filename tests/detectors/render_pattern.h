// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "detectors/images/marker_detector.h"
#include "tests/detectors/render.h"
#include "tests/digest.h"
#include "tests/optional_data.h"

namespace plenocal::testing {

/// Places in the image by marker number.
using Places = std::map<int, Eigen::Vector2d>;

inline Places Measured(const MarkerDetections& found) {
  Places places;
  for (const Observation& o : found.markers) places[o.marker] = {o.values[0], o.values[1]};
  return places;
}

/// The files of an optional data set whose names match, sorted; empty where the set is absent.
inline std::vector<std::filesystem::path> OptionalFiles(const std::string& folder,
                                                        const std::string& prefix,
                                                        const std::string& extension) {
  std::vector<std::filesystem::path> files;
  const auto path = OptionalData("frames/" + folder);
  if (!std::filesystem::exists(path)) return files;
  for (const auto& entry : std::filesystem::directory_iterator(path)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with(prefix) && name.ends_with(extension)) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// Errors of detections against the truth.
struct Statistics {
  double squares = 0, normalized_squares = 0;
  int markers = 0;

  void Add(const MarkerDetections& found, const Places& truth) {
    for (const Observation& o : found.markers) {
      const Eigen::Vector2d error = Eigen::Vector2d(o.values[0], o.values[1]) - truth.at(o.marker);
      squares += error.squaredNorm();
      normalized_squares += error.squaredNorm() / (o.detector_sigma * o.detector_sigma);
      ++markers;
    }
  }
  /// Of both coordinates together, px.
  [[nodiscard]] double Rms() const { return std::sqrt(squares / markers); }
  /// Mean (error / sigma)^2 of a coordinate.
  [[nodiscard]] double Ratio() const { return normalized_squares / (2 * markers); }
};

/// A view of a plane with unit spacing, `pitch` px, tilted, some hundred px from the image's
/// corner; `turn` (rad) rotates it in the image about (x, y).
inline Eigen::Matrix3d TiltedView(double pitch, double turn, double x, double y) {
  Eigen::Matrix3d H;
  H << pitch, 0.08 * pitch, 0, -0.05 * pitch, 0.95 * pitch, 0, 0.006, 0.004, 1;
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  R.topLeftCorner<2, 2>() = Eigen::Rotation2Dd(turn).toRotationMatrix();
  R(0, 2) = x;
  R(1, 2) = y;
  return R * H;
}

/// The same with the plane's point `middle` at the image's `at`.
inline Eigen::Matrix3d CentredView(double pitch,
                                   double turn,
                                   const Eigen::Vector2d& middle,
                                   const Eigen::Vector2d& at) {
  const Eigen::Matrix3d H = TiltedView(pitch, turn, 0, 0);
  Eigen::Matrix3d shift = Eigen::Matrix3d::Identity();
  shift.topRightCorner<2, 1>() = at - (H * middle.homogeneous()).hnormalized();
  return shift * H;
}

/// Of numbers, places (px), sigmas (0.01 px) and what was left out.
inline double DigestOf(const MarkerDetections& found) {
  Digest digest;
  for (const Observation& o : found.markers) {
    digest.Add(o.marker);
    digest.AddAll(o.values);
    digest.Add(100 * o.detector_sigma);
  }
  digest.Add(static_cast<double>(found.left_out.size()));
  return digest.Sum();
}

/// That detections in images near the border of what can be found are those of the version that
/// the digests were written for. Clang, sanitizers, and OpenCV without AVX change them by less than
/// the tolerance.
inline void ExpectDigests(MarkerDetector& detector,
                          const std::vector<cv::Mat>& images,
                          const std::vector<double>& expected) {
  ASSERT_EQ(images.size(), expected.size());
  for (std::size_t i = 0; i < images.size(); ++i) {
    const MarkerDetections found = detector.Detect(images[i]);
    EXPECT_NEAR(DigestOf(found), expected[i], 2e-3)
        << "image " << i << ": " << found.markers.size() << " markers, " << found.failure;
  }
}

/// An image under uneven light: from `least` of it in the left to all of it in the right.
inline cv::Mat UnevenlyLit(const cv::Mat& image, double least) {
  cv::Mat lit = image.clone();
  for (int x = 0; x < image.cols; ++x) lit.col(x) *= least + (1 - least) * x / image.cols;
  return lit;
}

/// Images that hold no target and must be refused: tiny, constant, noise.
inline std::vector<cv::Mat> EmptyImages() {
  cv::Mat noise(240, 320, CV_8UC1);
  cv::RNG random(5);
  random.fill(noise, cv::RNG::UNIFORM, 0, 256);
  return {cv::Mat(1, 1, CV_8UC1, cv::Scalar(7)),
          cv::Mat(8, 8, CV_8UC1, cv::Scalar(255)),
          cv::Mat(3, 500, CV_8UC1, cv::Scalar(0)),
          cv::Mat(240, 320, CV_8UC1, cv::Scalar(128)),
          noise};
}

inline void ExpectWellFormed(const MarkerDetections& found) {
  EXPECT_EQ(found.failure.empty(), !found.markers.empty());
  for (std::size_t i = 0; i < found.markers.size(); ++i) {
    EXPECT_GT(found.markers[i].detector_sigma, 0);
    EXPECT_TRUE(i == 0 || found.markers[i - 1].marker < found.markers[i].marker);
  }
}

}  // namespace plenocal::testing
