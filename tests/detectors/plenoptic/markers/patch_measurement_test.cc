// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/patch_measurement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "tests/detectors/plenoptic/depth/wave_scene.h"

namespace plenocal::internal {
namespace TEST_FILE {

constexpr double kScale = 2;  // raw px per pixel of the focused image
constexpr float kNoise = 0.5F;

/// Points of a plane of waves, found in a frame that showed the plane turned, sheared and larger.
class PatchMeasurement : public ::testing::Test {
 protected:
  PatchMeasurement() {
    scene_.amplitude = 8;
    scene_.noise = kNoise;
    patches_ = scene_.Patches();
    const cv::Size size(scene_.array.image_size[0] / 2, scene_.array.image_size[1] / 2);
    view_.depth.scale = kScale;
    view_.depth.inverse = cv::Mat(size, CV_32F, cv::Scalar(1 / scene_.v));
    view_.depth.known = cv::Mat(size, CV_8U, cv::Scalar(255));
    view_.noise = {kNoise * kNoise, 0};
    by_reference_ << 0.95, -0.12, 0.2, 0.9;
    // The point of the scene at a pixel of the focused image is seen in the middle of a micro image
    // that has its centre there.
    reference_ = cv::Mat(size, CV_8U);
    for (int y = 0; y < size.height; ++y) {
      for (int x = 0; x < size.width; ++x) {
        MicroLens at;
        at.centre = kScale * (kMiddle + by_reference_ * (Eigen::Vector2d(x, y) - kMiddle));
        reference_.at<uchar>(y, x) = cv::saturate_cast<uchar>(scene_.Value(at.centre, at));
      }
    }
  }

  [[nodiscard]] ScenePatch At(int number, const Eigen::Vector2d& in_reference) const {
    return {.number = number,
            .reference = &reference_,
            .in_reference = in_reference,
            .position = kMiddle + by_reference_ * (in_reference - kMiddle),
            .by_reference = by_reference_};
  }
  [[nodiscard]] std::vector<ScenePatch> Points() const {
    std::vector<ScenePatch> points;
    for (int i = 0; i < 9; ++i) {
      points.push_back(
          At(20 - i, kMiddle + Eigen::Vector2d(14.3 * (i % 3 - 1), 13.6 * (i / 3 - 1))));
    }
    return points;
  }
  [[nodiscard]] RawMeasurements Measure(const std::vector<ScenePatch>& points) const {
    return MeasurePatches(points, view_, patches_, scene_.array, 2);
  }

  const Eigen::Vector2d kMiddle{100.25, 98.5};  // focused px
  WaveScene scene_;
  LensPatches patches_;
  Reconstruction view_;
  Eigen::Matrix2d by_reference_;
  cv::Mat reference_;
};

TEST_F(PatchMeasurement, IsWhereTheMicroLensesShowThePoint) {
  const std::vector<ScenePatch> points = Points();
  const RawMeasurements found = Measure(points);
  double squares = 0, from_centre = 0;
  int marker = 0;
  for (const MarkerMeasurement& m : found) {
    EXPECT_GE(m.observation.marker, marker) << "in the order of their numbers";
    marker = m.observation.marker;
    const Eigen::Vector2d q = kScale * points[static_cast<size_t>(20 - marker)].position;
    const Eigen::Vector2d error = m.Position() - m.Centre() - (q - m.Centre()) / scene_.v;
    EXPECT_LT(error.norm(), 0.1);
    EXPECT_LE((q - m.Centre()).norm() / scene_.v, 0.36 * scene_.array.Pitch());
    EXPECT_NEAR(m.inverse_depth, 1 / scene_.v, 0.002);
    squares += error.squaredNorm() / (m.observation.detector_sigma * m.observation.detector_sigma);
    from_centre += (m.Position() - m.Centre()).norm();
  }
  const auto count = static_cast<double>(found.size());
  EXPECT_GT(count, 40);
  EXPECT_NEAR(squares / (2 * count), 1, 0.5);
  EXPECT_GT(from_centre / count, 0.15 * scene_.array.Pitch());
}

TEST_F(PatchMeasurement, HasItsDepthFromThePositions) {
  const std::vector<ScenePatch> points = Points();
  view_.depth.inverse = 1.03 / scene_.v;
  for (const MarkerMeasurement& m : Measure(points)) {
    EXPECT_NEAR(m.inverse_depth, 1 / scene_.v, 0.002);
  }
}

// The variance of the sensor's noise is 25, then 25 + 0.1 times the light.
TEST_F(PatchMeasurement, HasAtLeastTheSigmaOfTheSensorsNoise) {
  view_.noise = {25, 0};
  const RawMeasurements by_read = Measure(Points());
  view_.noise = {25, 0.1F};
  const RawMeasurements by_both = Measure(Points());
  ASSERT_GT(by_read.size(), 40U);
  ASSERT_EQ(by_both.size(), by_read.size());
  for (size_t i = 0; i < by_read.size(); ++i) {
    const double sigma = by_read[i].observation.detector_sigma;
    EXPECT_NEAR(by_both[i].observation.detector_sigma / sigma, std::sqrt(40 / 25.0), 0.03);
  }
}

TEST_F(PatchMeasurement, LeavesOutAMicroImageThatDisagrees) {
  const std::vector<ScenePatch> points{At(3, kMiddle)};
  const RawMeasurements before = Measure(points);
  ASSERT_GT(before.size(), 5U);
  // The whole micro image moves by a pixel to the right.
  const auto lens = static_cast<size_t>(
      std::ranges::find(scene_.array.lenses, before[2].Centre(), &MicroLens::centre) -
      scene_.array.lenses.begin());
  float* const values = patches_.value.data() + lens * patches_.Area();
  std::rotate(values, values + patches_.Area() - 1, values + patches_.Area());
  const RawMeasurements after = Measure(points);
  EXPECT_EQ(after.size(), before.size() - 1);
  EXPECT_TRUE(std::ranges::none_of(
      after, [&](const MarkerMeasurement& m) { return m.Centre() == before[2].Centre(); }));
}

TEST_F(PatchMeasurement, IsNoneWhereDepthChangesOrIsUnknown) {
  const std::vector<ScenePatch> points{At(3, kMiddle)};
  // Half of the patch is within 5 px of its middle: by equation 1 its parts move by up to 0.35 of a
  // pitch times a relative change of depth.
  const auto slope = [&](double moved_px) {
    const double per_px = moved_px / (5 * 0.35 * scene_.array.Pitch());
    for (int x = 0; x < view_.depth.inverse.cols; ++x) {
      view_.depth.inverse.col(x) = (1 + per_px * (x - 100)) / scene_.v;
    }
  };
  slope(0.7);
  EXPECT_TRUE(Measure(points).empty());
  slope(0.35);
  EXPECT_FALSE(Measure(points).empty());
  slope(0);
  view_.depth.known.colRange(0, 103) = 0;
  EXPECT_TRUE(Measure(points).empty());
  view_.depth.known.colRange(88, 103) = 255;
  EXPECT_FALSE(Measure(points).empty());
}

TEST_F(PatchMeasurement, IsNoneOfAnotherPoint) {
  ScenePatch other = At(3, kMiddle);
  other.in_reference += Eigen::Vector2d(9, 5);
  EXPECT_TRUE(Measure({other}).empty());
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
