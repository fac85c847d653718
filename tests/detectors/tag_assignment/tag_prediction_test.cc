// SPDX-License-Identifier: Apache-2.0
#include "detectors/tag_assignment/tag_prediction.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <set>

namespace plenocal::internal {
namespace TEST_FILE {

/// A grid of 5 x 4 squares of 2 cm, 3 cm apart, in some plane of space, and on its right a face at
/// a right angle to it with three squares more.
std::map<int, QuadPoints> Box() {
  const Eigen::Isometry3d T = Eigen::Translation3d(0.2, -0.1, 0.4) *
                              Eigen::AngleAxisd(0.8, Eigen::Vector3d(0.2, 1, -0.4).normalized());
  std::map<int, QuadPoints> squares;
  for (int i = 0; i < 20; ++i) {
    const double x = 0.03 * (i % 5), y = 0.03 * (i / 5);
    squares[i] = {T * Eigen::Vector3d(x, y, 0),
                  T * Eigen::Vector3d(x + 0.02, y, 0),
                  T * Eigen::Vector3d(x + 0.02, y + 0.02, 0),
                  T * Eigen::Vector3d(x, y + 0.02, 0)};
  }
  for (int i = 0; i < 3; ++i) {
    const double y = 0.03 * i;
    squares[100 + i] = {T * Eigen::Vector3d(0.15, y, 0.01),
                        T * Eigen::Vector3d(0.15, y, 0.03),
                        T * Eigen::Vector3d(0.15, y + 0.02, 0.03),
                        T * Eigen::Vector3d(0.15, y + 0.02, 0.01)};
  }
  return squares;
}

/// A pinhole camera's image, the target in front of it.
Quad Image(const QuadPoints& square) {
  Quad quad;
  for (size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d p = square[k] + Eigen::Vector3d(0, 0, 0.2);
    quad[k] = 700 * p.hnormalized() + Eigen::Vector2d(320, 240);
  }
  return quad;
}

double LargestDistance(const Quad& a, const Quad& b) {
  double largest = 0;
  for (size_t k = 0; k < 4; ++k) largest = std::max(largest, (a[k] - b[k]).norm());
  return largest;
}

TEST(TagPrediction, IsByTheHomographyOfTheNeighbours) {
  const std::map<int, QuadPoints> target = Box();
  const Quad expected = Image(target.at(7));
  for (const std::set<int>& ids : {std::set{8}, {6, 2}, {0, 4, 19}, {1, 2, 3, 6, 8, 11, 12, 13}}) {
    std::map<int, Quad> found;
    for (const int id : ids) found[id] = Image(target.at(id));
    for (const Neighbours which : {Neighbours::kAll, Neighbours::kNearest}) {
      const auto prediction = Predict(target, 7, found, which);
      ASSERT_TRUE(prediction);
      EXPECT_LT(LargestDistance(prediction->corners, expected), 1e-6);
    }
  }
}

TEST(TagPrediction, RestsOnTheNearest) {
  const std::map<int, QuadPoints> target = Box();
  std::map<int, Quad> found;
  for (const int id : {0, 5, 9, 17, 19}) found[id] = Image(target.at(id));
  // In sides of 2 cm from square 6: 5 is 1.5 away, 0 2.1, 17 3.4, 9 4.5, 19 5.4.
  const auto all = Predict(target, 6, found, Neighbours::kAll),
             nearest = Predict(target, 6, found, Neighbours::kNearest);
  EXPECT_EQ(all->neighbours, 4U);
  EXPECT_EQ(nearest->neighbours, 2U);
  EXPECT_NEAR(all->distance, 1.5, 1e-9);
  // The farthest one does not count.
  found[19][2].x() += 20;
  EXPECT_LT(
      LargestDistance(Predict(target, 6, found, Neighbours::kAll)->corners, Image(target.at(6))),
      1e-6);
  found[9][2].x() += 20;
  EXPECT_GT(
      LargestDistance(Predict(target, 6, found, Neighbours::kAll)->corners, Image(target.at(6))),
      0.1);
  EXPECT_LT(LargestDistance(Predict(target, 6, found, Neighbours::kNearest)->corners,
                            Image(target.at(6))),
            1e-6);
}

TEST(TagPrediction, IsOfSquaresInThePlane) {
  const std::map<int, QuadPoints> target = Box();
  std::map<int, Quad> found{{100, Image(target.at(100))}, {101, Image(target.at(101))}};
  EXPECT_FALSE(Predict(target, 4, found, Neighbours::kAll)) << "they are on another face";
  const auto own_face = Predict(target, 102, found, Neighbours::kAll);
  ASSERT_TRUE(own_face);
  EXPECT_LT(LargestDistance(own_face->corners, Image(target.at(102))), 1e-6);
  EXPECT_FALSE(Predict(target, 4, {}, Neighbours::kAll));
  // Itself is no neighbour.
  EXPECT_FALSE(Predict(target, 4, {{4, Image(target.at(4))}}, Neighbours::kAll));
}

TEST(TagPrediction, IsNothingBehindTheCamera) {
  // A strip that is seen at a grazing angle: far along it, it passes the camera.
  std::map<int, QuadPoints> target;
  for (int i = 0; i < 30; ++i) {
    const auto at = [&](double along, double across) {
      return Eigen::Vector3d(across, 0.05, 0.5 - along);
    };
    const double from = 0.03 * i;
    target[i] = {at(from, 0), at(from + 0.02, 0), at(from + 0.02, 0.02), at(from, 0.02)};
  }
  const std::map<int, Quad> found{{0, Image(target.at(0))}, {1, Image(target.at(1))}};
  EXPECT_TRUE(Predict(target, 10, found, Neighbours::kAll));
  EXPECT_FALSE(Predict(target, 29, found, Neighbours::kAll));
}

TEST(TagPrediction, SmoothIsOfTheSquareAndItsNeighbours) {
  const std::map<int, QuadPoints> target = Box();
  std::map<int, Quad> found;
  for (const int id : {1, 5, 6, 7, 11}) found[id] = Image(target.at(id));
  const Quad exact = found[6];
  auto smooth = Smooth(target, 6, found);
  EXPECT_LT(LargestDistance(smooth->corners, exact), 1e-6);
  EXPECT_EQ(smooth->neighbours, 5U);
  EXPECT_EQ(smooth->distance, 0);
  // Of a corner's error a part stays: by five squares less than half, by itself all.
  found[6][1] += Eigen::Vector2d(1, 1);
  smooth = Smooth(target, 6, found);
  EXPECT_GT(LargestDistance(smooth->corners, exact), 0.05);
  EXPECT_LT(LargestDistance(smooth->corners, exact), 0.5 * std::sqrt(2));
  const auto alone = Smooth(target, 6, {{6, found[6]}});
  EXPECT_LT(LargestDistance(alone->corners, found[6]), 1e-6);
}

TEST(TagPrediction, SquaresHaveCentreSideAndShape) {
  const Quad square{Eigen::Vector2d(1, 1), {5, 1}, {5, 4}, {1, 4}};
  EXPECT_EQ(CentreOf(square), Eigen::Vector2d(3, 2.5));
  EXPECT_EQ(Side(square), 3.5);
  EXPECT_TRUE(Convex(square));
  const Quad turned{square[3], square[2], square[1], square[0]};
  EXPECT_TRUE(Convex(turned));
  Quad dented = square;
  dented[2] = {2, 2};
  EXPECT_FALSE(Convex(dented));
  EXPECT_FALSE(Convex({square[0], square[2], square[1], square[3]})) << "crossed";
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
