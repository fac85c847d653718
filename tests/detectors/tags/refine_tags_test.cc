// SPDX-License-Identifier: Apache-2.0
#include "detectors/tags/refine_tags.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
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

TEST(RefineTags, WhatCoversPartOfATagDoesNotDisplaceItsCorners) {
  const SyntheticTag tag(4);
  for (const double side : {60.0, 140.0}) {
    const Eigen::Matrix3d H = TagView(side, 0.3, Middle(side));
    const auto uncovered = View(tag, H);
    const double from = Middle(side).x() + 0.1 * side, to = from + 0.12 * side;  // a cable
    const auto covered = [&](const Eigen::Vector2d& x) {
      return x.x() > from && x.x() < to ? 130.0 : uncovered(x);
    };
    const cv::Mat gray = Render(covered, SizeFor(side), {.blur = 0.7, .noise = 1});
    const Quad truth = TagCorners(H);
    const std::vector<SeenTag> seen{{Displaced(truth, 0.5), tag.bits}};
    const RefinedTags refined = RefineTags(gray, seen, SyntheticTag::Border());
    for (std::size_t k = 0; k < 4; ++k) {
      const auto& corner = refined.quads[0][k];
      ASSERT_TRUE(corner) << side << " px, corner " << k;
      EXPECT_LT((corner->point - truth[k]).norm(), 0.06) << side << " px, corner " << k;
    }
  }
}

TEST(RefineTags, MeasuresCornersOfLargeTagsOneByOneWhereTheLensBendsThem) {
  // An equidistant fisheye; a tag takes up 40 degrees.
  const SyntheticTag tag(4);
  constexpr double kF = 250, kSide = 170;
  const cv::Size size(500, 500);
  const Eigen::Vector2d centre(249.5, 249.5);
  const auto ideal = [&](const Eigen::Vector2d& x) -> Eigen::Vector2d {
    const Eigen::Vector2d q = x - centre;
    const double angle = q.norm() / kF;
    return centre + (angle > 0 ? std::tan(angle) / angle : 1.0) * q;
  };
  std::vector<Eigen::Matrix3d> views;
  std::vector<SeenTag> seen;
  for (const Eigen::Vector2d& middle :
       {Eigen::Vector2d(130, 130), {370, 130}, {370, 370}, {130, 370}}) {
    views.push_back(TagView(1.2 * kSide, 0.2, ideal(middle)));
    Quad corners = TagCorners(views.back());
    for (auto& corner : corners) {
      const Eigen::Vector2d q = corner - centre;
      corner = centre + kF * std::atan(q.norm() / kF) / q.norm() * q;
    }
    seen.push_back({corners, tag.bits});
  }
  const auto scene = [&](const Eigen::Vector2d& x) {
    const std::size_t i =
        x.y() < centre.y() ? (x.x() < centre.x() ? 0 : 1) : (x.x() < centre.x() ? 3 : 2);
    return View(tag, views[i])(ideal(x));
  };
  const cv::Mat gray = Render(scene, size, {.blur = 0.7, .noise = 1});
  const RefinedTags refined = RefineTags(gray, seen, SyntheticTag::Border());
  double square = 0;
  int checked = 0;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    for (std::size_t k = 0; k < 4; ++k) {
      const auto& corner = refined.quads[i][k];
      if (!corner) continue;
      const double error = (corner->point - seen[i].corners[k]).squaredNorm();
      EXPECT_LT(std::sqrt(error), 5 * corner->sigma + 0.01) << i << ", " << k;
      square += error / 2;
      ++checked;
    }
  }
  EXPECT_EQ(checked, 16);
  EXPECT_LT(std::sqrt(square / checked), 0.02);
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
