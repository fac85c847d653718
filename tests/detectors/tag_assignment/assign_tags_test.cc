// SPDX-License-Identifier: Apache-2.0
//
// Tags of several boards that share numbers, in synthetic images with noise and distortion.
#include "detectors/tag_assignment/assign_tags.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <optional>
#include <random>
#include <vector>

namespace plenocal::internal {
namespace TEST_FILE {

// Rows of tags upwards; sides of 1.
TagPositions Grid(int columns, int rows, double spacing = 0.3, int first_id = 0) {
  TagPositions grid;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const double x = column * (1 + spacing), y = row * (1 + spacing);
      grid[first_id + row * columns + column] = {Eigen::Vector3d(x, y, 0),
                                                 Eigen::Vector3d(x + 1, y, 0),
                                                 Eigen::Vector3d(x + 1, y + 1, 0),
                                                 Eigen::Vector3d(x, y + 1, 0)};
    }
  }
  return grid;
}

// Where the first tag's corner is (sides), turned about x and y, 25 sides away.
Eigen::Isometry3d Pose(double x, double y, double about_x, double about_y, double away = 25) {
  return Eigen::Translation3d(x, y, away) * Eigen::AngleAxisd(about_y, Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(about_x, Eigen::Vector3d::UnitX());
}

// What a camera of 800 x 600 px with barrel distortion reads.
class Image {
 public:
  explicit Image(unsigned seed) : random_(seed) {}

  // `outline`: px by which each tag is read too large.
  void Add(const TagPositions& board,
           const Eigen::Isometry3d& pose,
           std::optional<std::size_t> target,
           double outline = 0) {
    for (const auto& [id, points] : board) {
      ReadTag& quad = read.emplace_back();
      quad.id = id;
      for (std::size_t k = 0; k < 4; ++k) quad.corners[k] = Project(pose * points[k]);
      const Eigen::Vector2d centre = CentreOf(quad.corners);
      for (Eigen::Vector2d& corner : quad.corners) {
        corner += outline * (corner - centre).normalized() + Noise();
      }
      truth.push_back(target);
    }
  }

  // Keeps the tags with these indices.
  void Keep(const std::vector<std::size_t>& kept) {
    std::vector<ReadTag> some;
    std::vector<std::optional<std::size_t>> of_some;
    for (const std::size_t i : kept) {
      some.push_back(read[i]);
      of_some.push_back(truth[i]);
    }
    read = some;
    truth = of_some;
  }

  std::vector<ReadTag> read;
  std::vector<std::optional<std::size_t>> truth;

 private:
  static Eigen::Vector2d Project(const Eigen::Vector3d& p) {
    const Eigen::Vector2d x = p.hnormalized();
    constexpr double kFocal = 700, kDistortion = -0.2;
    return kFocal * (1 + kDistortion * x.squaredNorm()) * x + Eigen::Vector2d(400, 300);
  }
  Eigen::Vector2d Noise() {
    std::normal_distribution<double> noise(0, 0.2);  // px
    const double x = noise(random_);
    return {x, noise(random_)};
  }

  std::mt19937 random_;
};

struct Count {
  int right = 0, wrong = 0, several = 0, none = 0;
};

Count Sort(const Image& image, const std::vector<TagPositions>& targets) {
  Count count;
  const std::vector<TagOwner> owners = AssignTags(image.read, targets);
  EXPECT_EQ(owners.size(), image.read.size());
  for (std::size_t i = 0; i < owners.size(); ++i) {
    if (owners[i].target) {
      ++(owners[i].target == image.truth[i] ? count.right : count.wrong);
    } else {
      ++(owners[i].fits_several ? count.several : count.none);
    }
  }
  return count;
}

const Eigen::Isometry3d kLeft = Pose(-10, -4, 0.3, 0.2), kRight = Pose(1, -4, -0.2, -0.5);
constexpr unsigned kSeeds = 20;

TEST(AssignTags, GridsOfOtherCountsAreToldApart) {
  const std::vector<TagPositions> targets{Grid(6, 6), Grid(5, 7)};
  for (unsigned seed = 0; seed < kSeeds; ++seed) {
    Image image(seed);
    image.Add(targets[0], kLeft, 0);
    image.Add(targets[1], kRight, 1);
    const Count count = Sort(image, targets);
    EXPECT_EQ(count.right, 71) << seed;
    EXPECT_EQ(count.wrong, 0) << seed;
  }
}

TEST(AssignTags, OneBoardInViewIsNotTheOther) {
  const std::vector<TagPositions> targets{Grid(6, 6), Grid(5, 7)};
  for (std::size_t k = 0; k < 2; ++k) {
    Image image(1);
    image.Add(targets[k], kRight, k);
    EXPECT_EQ(Sort(image, targets).right, std::ssize(targets[k]));
  }
}

TEST(AssignTags, AnotherSpacingIsEnough) {
  const std::vector<TagPositions> targets{Grid(6, 6, 0.3), Grid(6, 6, 0.2)};
  for (unsigned seed = 0; seed < kSeeds; ++seed) {
    Image image(seed);
    image.Add(targets[1], kLeft, 1);
    image.Add(targets[0], kRight, 0);
    const Count count = Sort(image, targets);
    EXPECT_EQ(count.right, 72) << seed;
    EXPECT_EQ(count.wrong, 0) << seed;
  }
}

TEST(AssignTags, MissingTagsAndFalseOnesDoNotMatter) {
  const std::vector<TagPositions> targets{Grid(6, 6), Grid(5, 7)};
  std::mt19937 random(1);
  int right = 0, shown = 0;
  for (unsigned seed = 0; seed < kSeeds; ++seed) {
    Image image(seed);
    image.Add(targets[0], kLeft, 0);
    image.Add(targets[1], kRight, 1);
    std::vector<std::size_t> kept;
    for (std::size_t i = 0; i < image.read.size(); ++i) {
      if (random() % 2 == 0) kept.push_back(i);
    }
    image.Keep(kept);
    shown += static_cast<int>(kept.size());
    // Tags read where there are none, most of them with numbers that are in view already.
    for (int i = 0; i < 3; ++i) {
      const auto at = [&](int size) { return static_cast<double>(random() % size) / size; };
      image.Add({{static_cast<int>(random() % 35), Grid(1, 1).at(0)}},
                Pose(-10 + 18 * at(100), -7 + 14 * at(100), at(10), at(10)),
                std::nullopt);
    }
    const Count count = Sort(image, targets);
    right += count.right;
    EXPECT_EQ(count.wrong, 0) << seed;
  }
  EXPECT_GT(right, 0.97 * shown);
}

TEST(AssignTags, WhatFitsBothIsLeftOut) {
  const std::vector<TagPositions> targets{Grid(6, 6), Grid(5, 7)};
  Image image(1);
  image.Add(targets[0], kLeft, 0);
  image.Keep({0, 1, 2, 3, 4});  // five tags of the first row are the same on both
  Count count = Sort(image, targets);
  EXPECT_EQ(count.several, 5);
  // The sixth is on another row of the other board.
  Image more(1);
  more.Add(targets[0], kLeft, 0);
  more.Keep({0, 1, 2, 3, 4, 5});
  EXPECT_EQ(Sort(more, targets).right, 6);
  // One tag has no neighbours that decide.
  image.Keep({2});
  count = Sort(image, targets);
  EXPECT_EQ(count.several, 1);
  // Unless its number is on one of them only.
  Image single(1);
  single.Add(targets[0], kLeft, 0);
  single.Keep({35});
  EXPECT_EQ(Sort(single, targets).right, 1);
}

TEST(AssignTags, ATargetIsInTheImageOnce) {
  // The second begins with the fourth row of the first.
  const std::vector<TagPositions> targets{Grid(6, 6), Grid(6, 6, 0.3, 18)};
  std::vector<std::size_t> common;
  for (std::size_t i = 0; i < 18; ++i) common.push_back(i);
  Image alone(1);
  alone.Add(targets[1], kRight, 1);
  alone.Keep(common);
  EXPECT_EQ(Sort(alone, targets).several, 18);
  // Beside the whole first board the same tags are the second's.
  Image both(1);
  both.Add(targets[1], kRight, 1);
  both.Keep(common);
  both.Add(targets[0], kLeft, 0);
  EXPECT_EQ(Sort(both, targets).right, 54);
}

TEST(AssignTags, OutlinesThatAreOffDoNotDecide) {
  // Tags that are read too large have less space between them.
  constexpr double kOutline = 0.5;  // px
  int wrong = 0, decided = 0;
  for (const double other : {0.29, 0.28, 0.27, 0.26, 0.25, 0.2, 0.1}) {
    const std::vector<TagPositions> targets{Grid(6, 6, 0.3), Grid(6, 6, other)};
    for (unsigned seed = 0; seed < kSeeds; ++seed) {
      Image image(seed);
      image.Add(targets[0], kLeft, 0, kOutline);
      const Count count = Sort(image, targets);
      wrong += count.wrong;
      decided += count.right + count.wrong;
    }
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(decided, 0);
}

TEST(AssignTags, TagsOfAForeignBoardFitNoTarget) {
  const std::vector<TagPositions> targets{Grid(6, 6), Grid(5, 7)};
  Image image(1);
  image.Add(targets[0], kLeft, 0);
  image.Add(targets[1], Pose(1, -8, 0, 0), 1);
  image.Add(Grid(4, 4, 1.0), Pose(2, 2, 0, 0), std::nullopt);
  const Count count = Sort(image, targets);
  EXPECT_EQ(count.right, 71);
  EXPECT_EQ(count.wrong, 0);
  EXPECT_EQ(count.none, 16);
}

TEST(AssignTags, NothingReadIsNothingSorted) { EXPECT_TRUE(AssignTags({}, {Grid(2, 2)}).empty()); }

TEST(SamePrint, IsOneArrangementOfTheSameTagsAtAnySizeAndPlace) {
  const TagPositions board = Grid(3, 2);
  EXPECT_TRUE(IsSamePrint(board, board));
  TagPositions placed;
  for (const auto& [id, points] : board) {
    for (std::size_t k = 0; k < 4; ++k) placed[id][k] = 0.02 * (Pose(3, 1, 0.4, -0.2) * points[k]);
  }
  EXPECT_TRUE(IsSamePrint(board, placed));
  TagPositions moved = board, renumbered, fewer = board;
  moved.rbegin()->second[2].x() += 0.5;
  for (const auto& [id, points] : board) renumbered[id + 1] = points;
  fewer.erase(fewer.rbegin()->first);
  for (const TagPositions& other : {moved, renumbered, fewer, TagPositions{}}) {
    EXPECT_FALSE(IsSamePrint(board, other));
    EXPECT_FALSE(IsSamePrint(other, board));
  }
  EXPECT_FALSE(IsSamePrint({}, {}));
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
