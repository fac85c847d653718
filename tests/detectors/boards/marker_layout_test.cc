// SPDX-License-Identifier: Apache-2.0
#include "detectors/boards/marker_layout.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <functional>
#include <random>

namespace plenocal::internal {
namespace TEST_FILE {

// Place of a tilted board's point in the n-th image; the unit is a marker's side, y down.
Eigen::Vector2d Seen(const Eigen::Vector2d& p, int n) {
  const double angle = 0.3 * n, w = 1 + 0.004 * (n + 1) * p.x() - 0.006 * p.y();
  const Eigen::Vector2d turned(std::cos(angle) * p.x() - std::sin(angle) * p.y(),
                               std::sin(angle) * p.x() + std::cos(angle) * p.y());
  return Eigen::Vector2d(300, 200) + 20 * turned / w;
}

NumberedSquare Marker(int id, const Eigen::Vector2d& upper_left, int image) {
  NumberedSquare square{.id = id, .corners = {}};
  const Eigen::Vector2d corners[] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  for (size_t k = 0; k < 4; ++k) square.corners[k] = Seen(upper_left + corners[k], image);
  return square;
}

// Three images of a grid of markers; `id_of` (column, row from above).
std::vector<std::vector<NumberedSquare>> Grid(int columns,
                                              int rows,
                                              double pitch,
                                              const std::function<int(int, int)>& id_of) {
  std::vector<std::vector<NumberedSquare>> images(3);
  for (int image = 0; image < 3; ++image) {
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        images[static_cast<size_t>(image)].push_back(
            Marker(id_of(column, row), pitch * Eigen::Vector2d(column, row), image));
      }
    }
  }
  return images;
}

TEST(FindMarkerLayout, OfKalibrsGridCountsRowsUpwards) {
  for (const int first : {0, 12}) {
    const auto layout = FindMarkerLayout(
        Grid(6, 4, 1.3, [&](int column, int row) { return first + 6 * (3 - row) + column; }));
    ASSERT_TRUE(layout);
    EXPECT_EQ(layout->kind, MarkerLayout::Kind::kRowsUp);
    EXPECT_EQ(layout->columns, 6);
    EXPECT_EQ(layout->rows, 4);
    EXPECT_EQ(layout->first_id, first);
    EXPECT_NEAR(layout->pitch, 1.3, 0.03);
  }
}

TEST(FindMarkerLayout, OfAGridBoardCountsRowsDownwards) {
  const auto layout =
      FindMarkerLayout(Grid(5, 7, 1.5, [](int column, int row) { return 5 * row + column; }));
  ASSERT_TRUE(layout);
  EXPECT_EQ(layout->kind, MarkerLayout::Kind::kRowsDown);
  EXPECT_EQ(layout->columns, 5);
  EXPECT_EQ(layout->rows, 7);
  EXPECT_EQ(layout->first_id, 0);
  EXPECT_NEAR(layout->pitch, 1.5, 0.03);
}

// Squares are 1.4 markers wide; `parity` of column + row of the white ones.
std::vector<std::vector<NumberedSquare>> Charuco(int columns, int rows, int parity) {
  std::vector<std::vector<NumberedSquare>> images(3);
  for (int image = 0; image < 3; ++image) {
    int id = 0;
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        if ((column + row) % 2 != parity) continue;
        images[static_cast<size_t>(image)].push_back(
            Marker(id++, 1.4 * Eigen::Vector2d(column, row), image));
      }
    }
  }
  return images;
}

TEST(FindMarkerLayout, OfACharucoBoardIsInItsWhiteSquares) {
  for (const auto& [columns, rows, parity] :
       {std::tuple(7, 5, 1), {8, 6, 1}, {7, 5, 0}, {6, 9, 1}, {5, 8, 0}}) {
    const auto layout = FindMarkerLayout(Charuco(columns, rows, parity));
    ASSERT_TRUE(layout) << columns << " x " << rows;
    EXPECT_EQ(layout->kind, MarkerLayout::Kind::kCharuco) << columns << " x " << rows;
    EXPECT_EQ(layout->columns, columns);
    EXPECT_EQ(layout->rows, rows);
    EXPECT_NEAR(layout->pitch, 1.4, 0.03);
  }
}

TEST(FindMarkerLayout, IsFoundThoughMarkersAreMissingOrMisread) {
  auto images = Grid(6, 4, 1.3, [](int column, int row) { return 6 * (3 - row) + column; });
  std::mt19937 random(1);
  for (auto& squares : images) {
    std::erase_if(squares, [&](const NumberedSquare&) { return random() % 4 == 0; });
    squares[random() % squares.size()].id = 55;
  }
  const auto layout = FindMarkerLayout(images);
  ASSERT_TRUE(layout);
  EXPECT_EQ(layout->kind, MarkerLayout::Kind::kRowsUp);
  EXPECT_EQ(layout->columns, 6);
}

TEST(FindMarkerLayout, IsNoneOfMarkersWithoutOrder) {
  EXPECT_FALSE(FindMarkerLayout({}));
  EXPECT_FALSE(FindMarkerLayout({{Marker(3, {0, 0}, 0)}}));
  std::vector<int> ids(24);
  for (size_t i = 0; i < ids.size(); ++i)
    ids[i] = static_cast<int>(i * 7 % 24 * 5 % 24 + (i % 3) * 30);
  EXPECT_FALSE(FindMarkerLayout(Grid(
      6, 4, 1.3, [&](int column, int row) { return ids[static_cast<size_t>(6 * row + column)]; })));
  // Markers that overlap.
  EXPECT_FALSE(
      FindMarkerLayout(Grid(6, 4, 0.9, [](int column, int row) { return 6 * row + column; })));
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
