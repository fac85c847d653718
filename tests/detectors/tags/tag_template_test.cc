// SPDX-License-Identifier: Apache-2.0
#include "detectors/tags/tag_template.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <opencv2/core.hpp>

#include "tests/detectors/render.h"
#include "tests/detectors/tags/synthetic_tag.h"

namespace plenocal::internal {
namespace TEST_FILE {

using testing::Displaced;
using testing::Render;
using testing::SyntheticTag;
using testing::TagCorners;
using testing::TagView;
using testing::View;

const cv::Size kImage(70, 70);
const Eigen::Vector2d kMiddle(34.3, 35.1);

TEST(TagTemplate, SearchFollowsATagThatIsElsewhere) {
  const SyntheticTag tag(6);
  const Eigen::Matrix3d H = TagView(22, 0.2, kMiddle);
  const cv::Mat gray = Render(View(tag, H), kImage, {.blur = 0.7});
  Quad off = TagCorners(H);
  for (auto& corner : off) corner += Eigen::Vector2d(-4, 3);
  TagTemplate fitted(gray, {off, tag.bits}, SyntheticTag::Border(), 0.8);
  fitted.Search(5);
  for (std::size_t k = 0; k < 4; ++k) {
    EXPECT_LT((fitted.corners()[k] - TagCorners(H)[k]).norm(), 0.8);
  }
}

TEST(TagTemplate, DataCorrelateOnlyWithTheSameTag) {
  const SyntheticTag tag(6), other(7);
  const Eigen::Matrix3d H = TagView(24, 0.7, kMiddle);
  const cv::Mat gray = Render(View(tag, H), kImage, {.blur = 0.6});
  TagTemplate same(gray, {TagCorners(H), tag.bits}, SyntheticTag::Border(), 0.7);
  TagTemplate different(gray, {TagCorners(H), other.bits}, SyntheticTag::Border(), 0.7);
  EXPECT_GT(same.DataCorrelation(), 0.95);
  EXPECT_LT(different.DataCorrelation(), 0.6);
}

TEST(TagTemplate, DoesNotConvergeOnNoiseOrOnATagOfInvertedColours) {
  const SyntheticTag tag(6);
  const Eigen::Matrix3d H = TagView(24, 0.7, kMiddle);
  const SeenTag seen{TagCorners(H), tag.bits};
  const cv::Mat inverted = 255 - Render(View(tag, H), kImage, {.blur = 0.6});
  EXPECT_FALSE(TagTemplate(inverted, seen, SyntheticTag::Border(), 0.8).Approach());
  const cv::Mat flat(kImage, CV_8U, cv::Scalar(99));
  TagTemplate on_flat(flat, seen, SyntheticTag::Border(), 0.8);
  EXPECT_FALSE(on_flat.Approach() && on_flat.Fit(DistortionField({})));
}

TEST(TagTemplate, MeasuresTheDistortionOfTheLens) {
  // A barrel distortion about the image's middle, strong enough to bend a tag's edges by 0.2 px.
  const SyntheticTag tag(6);
  const cv::Size size(200, 200);
  const Eigen::Vector2d centre(99.5, 99.5);
  constexpr double kBarrel = 8e-6;  // px^-2
  const auto ideal = [&](const Eigen::Vector2d& x) -> Eigen::Vector2d {
    const Eigen::Vector2d q = x - centre;
    return centre + q * (1 + kBarrel * q.squaredNorm());
  };
  double with = 0, without = 0;
  int tags = 0;
  for (const Eigen::Vector2d& middle :
       {Eigen::Vector2d(40, 45), {160, 50}, {150, 160}, {45, 155}}) {
    const Eigen::Matrix3d H = TagView(40, 0.2, ideal(middle));
    const auto plane = View(tag, H);
    const auto scene = [&](const Eigen::Vector2d& x) { return plane(ideal(x)); };
    const cv::Mat gray = Render(scene, size, {.blur = 0.7, .supersampling = 4});
    Quad seen = TagCorners(H), truth;
    for (std::size_t k = 0; k < 4; ++k) {
      truth[k] = seen[k];
      // Fixed-point steps to where the lens images the corner.
      for (int i = 0; i < 30; ++i) truth[k] += seen[k] - ideal(truth[k]);
    }
    TagTemplate fitted(gray, {truth, tag.bits}, SyntheticTag::Border(), 0.8);
    const auto measurements = fitted.Approach();
    ASSERT_TRUE(measurements);
    TagTemplate straight = fitted;
    const auto with_field = fitted.Fit(DistortionField(*measurements));
    const auto without_field = straight.Fit(DistortionField({}));
    ASSERT_TRUE(with_field && without_field);
    for (std::size_t k = 0; k < 4; ++k) {
      with += (with_field->corners[k] - truth[k]).squaredNorm();
      without += (without_field->corners[k] - truth[k]).squaredNorm();
    }
    ++tags;
  }
  EXPECT_EQ(tags, 4);
  EXPECT_LT(with, 0.25 * without);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
