// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/track/feature_tracker.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace plenocal {
namespace TEST_FILE {

// A texture moved to the right, with noise of its own.
cv::Mat Image(const cv::Mat& texture, int shift) {
  cv::Mat image = texture(cv::Rect(100 - shift, 0, 300, 240)).clone(), errors(240, 300, CV_32F);
  cv::randn(errors, 0, 3);
  image += errors;
  cv::Mat grey;
  image.convertTo(grey, CV_8U);
  return grey;
}

TEST(FeatureTracker, StatesAsMuchNoiseForTheImageInWhichAPointIsFoundAsForOthers) {
  cv::theRNG().state = 7;
  cv::Mat texture(240, 400, CV_32F);
  cv::randn(texture, 0, 1);
  cv::GaussianBlur(texture, texture, {}, 3);
  texture = 128 + 250 * texture;
  const std::vector<BundleCamera> cameras(1);
  FeatureTracker tracker(cameras, {.wanted = 60}, 0);
  for (int i = 0; i < 4; ++i) tracker.AddFrame(std::to_string(i), {Image(texture, 2 * i)});
  std::map<int, std::vector<double>> variances;  // of each track's observations
  const std::vector<View> views = tracker.Views()[0];
  for (const View& view : views) {
    for (const Observation& seen : view.observations) {
      variances[seen.marker].push_back(std::pow(seen.detector_sigma, 2));
    }
  }
  ASSERT_GT(variances.size(), 30U);
  for (const auto& [number, of_track] : variances) {
    ASSERT_GE(of_track.size(), 2U) << number;
    const double others = std::accumulate(of_track.begin() + 1, of_track.end(), 0.0) /
                          static_cast<double>(of_track.size() - 1);
    EXPECT_NEAR(of_track[0] / others, 1, 1e-9) << number;
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
