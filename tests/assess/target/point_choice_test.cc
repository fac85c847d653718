// SPDX-License-Identifier: Apache-2.0
#include "assess/target/point_choice.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr double kSpacing = 30;  // px, of the points in the image
constexpr int kColumns = 9, kRows = 7;

// A tilted plane; points are one unit apart on it.
Eigen::Vector2d Seen(const Eigen::Vector2d& p, const Eigen::Vector2d& at) {
  const double w = 1 + 0.01 * p.x() - 0.008 * p.y();
  return at + kSpacing * Eigen::Vector2d(p.x() + 0.1 * p.y(), p.y() - 0.05 * p.x()) / w;
}

std::vector<Eigen::Vector2d> Grid() {
  std::vector<Eigen::Vector2d> points;
  for (int i = 0; i < kColumns * kRows; ++i) points.emplace_back(i % kColumns, i / kColumns);
  return points;
}

TEST(ChoosePlaces, TakesThePlacesThatAgree) {
  Random random(1);
  const std::vector<Eigen::Vector2d> points = Grid();
  std::vector<std::vector<Eigen::Vector2d>> places;
  for (const Eigen::Vector2d& p : points) {
    // The right one among others, anywhere in the list.
    std::vector<Eigen::Vector2d>& of_point = places.emplace_back();
    for (int k = 0; k < 2; ++k) {
      of_point.push_back(random.Uniforms<2>(0, 9).array().round().matrix());
    }
    of_point.insert(of_point.begin() + static_cast<int>(random.Uniform(0, 3)), p);
  }
  std::vector<PlaneChoice> choices;
  for (size_t i = 0; i < points.size(); ++i) {
    choices.push_back({Seen(points[i], {100, 80}) + random.Gaussians<2>(0.3), 1, &places[i]});
  }
  const PlaneMap::Pairs pairs = ChoosePlaces(choices, kSpacing);
  ASSERT_EQ(pairs.plane.size(), points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(pairs.plane[i], points[i]) << i;
    EXPECT_EQ(pairs.image[i], choices[i].image) << i;
  }
  // Two samples at least.
  choices.resize(7);
  EXPECT_TRUE(ChoosePlaces(choices, kSpacing).plane.empty());
}

// Points of which those with `is_other` belong to another target, elsewhere in the image.
template <typename IsOther>
PlaneMap::Pairs Pairs(const IsOther& is_other) {
  Random random(2);
  PlaneMap::Pairs pairs;
  int number = 0;
  for (const Eigen::Vector2d& p : Grid()) {
    const Eigen::Vector2d at =
        is_other(number++) ? Eigen::Vector2d(600, 300) : Eigen::Vector2d(100, 80);
    pairs.Add(p, Seen(p, at) + random.Gaussians<2>(0.3), 1);
  }
  return pairs;
}

TEST(FollowsOneMap, IsTrueButForAFewPoints) {
  EXPECT_TRUE(FollowsOneMap(Pairs([](int) { return false; }), kSpacing));
  EXPECT_TRUE(FollowsOneMap(Pairs([](int i) { return i % 9 == 4; }), kSpacing));  // 7
  EXPECT_FALSE(FollowsOneMap(Pairs([](int i) { return i % 3 == 1; }), kSpacing));
}

TEST(FollowsTwoMaps, IsTrueForPointsOfTwoTargets) {
  EXPECT_TRUE(FollowsTwoMaps(Pairs([](int i) { return i % 3 == 1; }), kSpacing));
  EXPECT_TRUE(FollowsTwoMaps(Pairs([](int i) { return i >= 36; }), kSpacing));
  EXPECT_FALSE(FollowsTwoMaps(Pairs([](int) { return false; }), kSpacing));
  EXPECT_FALSE(FollowsTwoMaps(Pairs([](int i) { return i % 9 == 4; }), kSpacing));  // 7 are too few
}

TEST(FollowsTwoMaps, IsFalseForScatteredMistakes) {
  Random random(3);
  PlaneMap::Pairs pairs;
  int number = 0;
  for (const Eigen::Vector2d& p : Grid()) {
    const bool wrong = number++ % 3 == 1;
    const Eigen::Vector2d anywhere = random.Uniforms<2>(300, 900);
    pairs.Add(p, wrong ? anywhere : Seen(p, {100, 80}), 1);
  }
  EXPECT_FALSE(FollowsOneMap(pairs, kSpacing));
  EXPECT_FALSE(FollowsTwoMaps(pairs, kSpacing));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
