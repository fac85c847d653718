// SPDX-License-Identifier: Apache-2.0
#include "detectors/tags/tag_edges.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

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

cv::Size SizeFor(double side) {
  const int extent = static_cast<int>(2 * side) + 30;
  return {extent, extent};
}
Eigen::Vector2d Middle(double side) { return {side + 15.2, side + 14.7}; }

TEST(RefineTags, MeasuresCornersOfTagsOfAllSizes) {
  const SyntheticTag tag(4);
  for (const double side : {20.0, 45.0, 80.0, 150.0}) {
    for (const double roll : {0.1, 1.0, 2.9}) {
      const Eigen::Matrix3d H = TagView(side, roll, Middle(side));
      const cv::Mat gray = Render(View(tag, H), SizeFor(side), {.blur = 0.7, .noise = 1});
      const Quad truth = TagCorners(H);
      const std::vector<SeenTag> seen{{Displaced(truth, 0.04 * side / tag.kWidth + 0.4), tag.bits}};
      const RefinedTags refined = RefineTags(gray, seen, SyntheticTag::Border());
      for (std::size_t k = 0; k < 4; ++k) {
        const auto& corner = refined.quads[0][k];
        ASSERT_TRUE(corner) << side << " px, roll " << roll << ", corner " << k;
        EXPECT_LT((corner->point - truth[k]).norm(), 0.06) << side << " px, roll " << roll;
        EXPECT_LT((corner->point - truth[k]).norm(), 5 * corner->sigma + 0.01);
      }
      EXPECT_FALSE(refined.measurements.empty());
    }
  }
}

TEST(RefineTags, MeasuresNothingWithoutContrast) {
  const SyntheticTag tag(4);
  for (const double side : {24.0, 90.0}) {
    const std::vector<SeenTag> seen{{TagCorners(TagView(side, 0.3, Middle(side))), tag.bits}};
    const cv::Mat gray(SizeFor(side), CV_8U, cv::Scalar(128));
    const RefinedTags refined = RefineTags(gray, seen, SyntheticTag::Border());
    for (const auto& corner : refined.quads[0]) {
      EXPECT_FALSE(corner) << side << " px";
    }
  }
}

TEST(RefineTags, AnotherTagInTheImageDoesNotMatter) {
  const SyntheticTag tag(4), other(9);
  const Eigen::Matrix3d H = TagView(70, 0.2, {60, 62}), H_other = TagView(25, 0.5, {160, 60});
  const auto left = View(tag, H), right = View(other, H_other);
  const auto both = [&](const Eigen::Vector2d& x) { return x.x() < 125 ? left(x) : right(x); };
  const cv::Mat gray = Render(both, {210, 125}, {.blur = 0.7, .supersampling = 4});
  const std::vector<SeenTag> seen{{TagCorners(H), tag.bits}, {TagCorners(H_other), other.bits}};
  const RefinedTags refined = RefineTags(gray, seen, SyntheticTag::Border());
  int checked = 0;
  for (std::size_t i = 0; i < 2; ++i) {
    for (std::size_t k = 0; k < 4; ++k) {
      if (!refined.quads[i][k]) continue;
      EXPECT_LT((refined.quads[i][k]->point - seen[i].corners[k]).norm(), 0.06) << i << ", " << k;
      ++checked;
    }
  }
  EXPECT_EQ(checked, 8);
}

TEST(FindTag, FindsATagNearTheExpectedPlace) {
  const SyntheticTag tag(4);
  for (const double side : {20.0, 120.0}) {
    const Eigen::Matrix3d H = TagView(side, 0.4, Middle(side));
    const cv::Mat gray = Render(View(tag, H), SizeFor(side), {.blur = 0.8, .noise = 2});
    const Quad truth = TagCorners(H);
    Quad expected = truth;
    for (auto& corner : expected) corner += Eigen::Vector2d(3, -2);
    const auto found = FindTag(gray, {expected, tag.bits}, SyntheticTag::Border(), 4);
    ASSERT_TRUE(found) << side << " px";
    for (std::size_t k = 0; k < 4; ++k) {
      EXPECT_LT(((*found)[k] - truth[k]).norm(), 0.05 * side / 8 + 0.2) << side << " px";
    }
  }
}

TEST(FindTag, RefusesAnotherTag) {
  const SyntheticTag tag(4), other(9);
  const Eigen::Matrix3d H = TagView(40, 0.4, Middle(40));
  const cv::Mat gray = Render(View(tag, H), SizeFor(40), {.blur = 0.8, .noise = 2});
  EXPECT_TRUE(FindTag(gray, {TagCorners(H), tag.bits}, SyntheticTag::Border(), 2));
  EXPECT_FALSE(FindTag(gray, {TagCorners(H), other.bits}, SyntheticTag::Border(), 2));
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
