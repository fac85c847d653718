// SPDX-License-Identifier: Apache-2.0
#include "calib/camera/lens_lattice.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

#include "calib/base/error.h"
#include "tests/calib/random.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using testing::Random;

constexpr ImageSize kSize{300, 240};

Eigen::Matrix2d Basis(double a_x, double a_y, double b_x, double b_y) {
  return (Eigen::Matrix2d() << a_x, b_x, a_y, b_y).finished();
}
const Eigen::Matrix2d kHexagonal = Basis(20, 0.6, 20 * 0.48, 17.5),
                      kRectangles = Basis(20, 0.5, -1, 31);

Eigen::Vector2d Straight(const Eigen::Matrix2d& basis, double column, double row) {
  return Eigen::Vector2d(148, 121) + basis * Eigen::Vector2d(column, row);
}

/// The nodes whose place(column, row) is in the image.
template <typename Place>
std::vector<LatticeMeasurement> Nodes(const Place& place) {
  std::vector<LatticeMeasurement> nodes;
  for (int row = -9; row <= 9; ++row) {
    for (int column = -14; column <= 14; ++column) {
      const Eigen::Vector2d at = place(column, row);
      if (IsInside(at, kSize)) nodes.push_back({.node = {column, row}, .position = at});
    }
  }
  return nodes;
}

TEST(LensLattice, IsInsideTheAreaOfThePixels) {
  for (const double margin : {0.0, 3.0}) {
    const double low = -0.5 - margin, right = 299.5 + margin, bottom = 239.5 + margin;
    EXPECT_TRUE(IsInside({low, low}, kSize, margin));
    EXPECT_TRUE(IsInside({right - 1e-9, bottom - 1e-9}, kSize, margin));
    EXPECT_FALSE(IsInside({low - 1e-9, 5}, kSize, margin));
    EXPECT_FALSE(IsInside({5, low - 1e-9}, kSize, margin));
    EXPECT_FALSE(IsInside({right, 5}, kSize, margin));
    EXPECT_FALSE(IsInside({5, bottom}, kSize, margin));
  }
}

TEST(LensLattice, KindsAreDividedAt75Degrees) {
  for (const double degrees : {60.0, 74.0, 76.0, 90.0, 104.0, 106.0, 120.0}) {
    const double angle = degrees * std::numbers::pi / 180;
    const Eigen::Matrix2d basis = Basis(3, 0, 5 * std::cos(angle), 5 * std::sin(angle));
    EXPECT_EQ(KindOfLattice(basis),
              degrees > 75 && degrees < 105 ? LatticeKind::kRectangular : LatticeKind::kHexagonal)
        << degrees;
  }
}

TEST(LensLattice, NeighboursAreAroundANode) {
  for (const Eigen::Matrix2d& basis : {kHexagonal, kRectangles}) {
    const LatticeKind kind = KindOfLattice(basis);
    const bool hexagonal = kind == LatticeKind::kHexagonal;
    // By definition: hexagonal the nodes at about one pitch; rectangular those that share a corner.
    std::set<LatticeNode> expected;
    for (int column = -3; column <= 3; ++column) {
      for (int row = -3; row <= 3; ++row) {
        const double distance = (basis * Eigen::Vector2d(column, row)).norm();
        const bool is_neighbour = hexagonal ? distance > 0 && distance < 1.3 * 20
                                            : std::max(std::abs(column), std::abs(row)) == 1;
        if (is_neighbour) expected.insert({column, row});
      }
    }
    const auto steps = LatticeNeighbours(kind);
    EXPECT_EQ(std::set(steps.begin(), steps.end()), expected);
    EXPECT_EQ(steps.size(), hexagonal ? 6U : 8U);
  }
}

TEST(LensLattice, PatternsDivideItIntoAsManySets) {
  for (const int sets : {1, 2, 3, 4, 6}) {
    std::set<std::vector<int>> divisions;
    for (const LensPattern& pattern : LensPatterns(sets)) {
      EXPECT_EQ(pattern.Sets(), sets);
      std::map<int, int> sizes;
      std::vector<int> division;
      for (int row = -12; row < 12; ++row) {
        for (int column = -12; column < 12; ++column) {
          const int set = pattern.Set({column, row});
          EXPECT_GE(set, 0);
          EXPECT_LT(set, sets);
          EXPECT_EQ(set, pattern.Set({column + pattern.columns, row}));
          EXPECT_EQ(set, pattern.Set({column + pattern.shift, row + pattern.rows}));
          ++sizes[set];
          division.push_back(set);
        }
      }
      EXPECT_EQ(sizes.size(), static_cast<size_t>(sets)) << "each set has nodes";
      divisions.insert(division);
    }
    // The sublattices of an index are as many as its divisors' sum (Hermite's normal form).
    int sublattices = 0;
    for (int divisor = 1; divisor <= sets; ++divisor) {
      if (sets % divisor == 0) sublattices += divisor;
    }
    EXPECT_EQ(divisions.size(), static_cast<size_t>(sublattices)) << sets;
  }
}

TEST(LensLattice, OfThreeInterleavedSetsHasNoEqualNeighbours) {
  for (const LatticeNode& step : LatticeNeighbours(LatticeKind::kHexagonal)) {
    EXPECT_NE(kThreeInterleaved.Set({4, -7}),
              kThreeInterleaved.Set({4 + step.column, -7 + step.row}));
  }
}

TEST(LensLattice, HasOneCanonicalBasis) {
  for (const Eigen::Matrix2d& canonical : {kHexagonal, kRectangles}) {
    const bool hexagonal = KindOfLattice(canonical) == LatticeKind::kHexagonal;
    const Eigen::Vector2d a = canonical.col(0), b = canonical.col(1);
    std::vector<Eigen::Vector2d> ring{a, b, -a, -b};
    if (hexagonal) ring.insert(ring.end(), {b - a, a - b});
    for (const Eigen::Vector2d& first : ring) {
      for (const Eigen::Vector2d& second : ring) {
        if (std::abs(first.x() * second.y() - first.y() * second.x()) < 1) continue;
        Eigen::Matrix2d basis;
        basis << first, second;
        EXPECT_LT((CanonicalLatticeBasis(basis) - canonical).norm(), 1e-12) << basis;
      }
    }
  }
}

TEST(LensLattice, IsFoundAroundAHole) {
  for (const Eigen::Matrix2d& basis : {kHexagonal, kRectangles}) {
    for (const LatticeNode& hole : {LatticeNode{0, 0}, {1, 0}, {0, 1}, {-1, 1}, {1, -1}}) {
      std::vector<Eigen::Vector2d> points;
      for (const LatticeMeasurement& m :
           Nodes([&](int column, int row) { return Straight(basis, column, row); })) {
        if (m.node != hole) points.push_back(m.position);
      }
      const auto found = FindLatticeBasis(points, kSize);
      ASSERT_TRUE(found);
      EXPECT_LT((*found - basis).norm(), 1e-9) << basis << " without " << hole.column;
    }
  }
  // A row has no neighbours on all sides; too few points have none.
  std::vector<Eigen::Vector2d> row;
  for (int i = 0; i < 12; ++i) row.emplace_back(20 * i, 100);
  EXPECT_FALSE(FindLatticeBasis(row, kSize));
  EXPECT_FALSE(FindLatticeBasis(std::span(row).first(3), kSize));
  EXPECT_FALSE(FindLatticeBasis({}, kSize));
}

/// A lens bends the lattice: the pitch changes by a fifth to the image's edge.
Eigen::Vector2d Bent(const Eigen::Matrix2d& basis, double column, double row) {
  const Eigen::Vector2d from = Straight(basis, column, row) - Eigen::Vector2d(150, 120);
  return Eigen::Vector2d(150, 120) + from * (1 - 0.07 * from.squaredNorm() / (190.0 * 190.0));
}

TEST(LensLattice, OfABentImageIsIndexed) {
  for (const Eigen::Matrix2d& basis : {kHexagonal, kRectangles}) {
    const std::vector<LatticeMeasurement> nodes =
        Nodes([&](int column, int row) { return Bent(basis, column, row); });
    std::vector<Eigen::Vector2d> points;
    for (const LatticeMeasurement& m : nodes) points.push_back(m.position);
    points.push_back(Bent(basis, 1.5, 1.5));  // between nodes
    const auto found = IndexLattice(points, basis, kSize);
    ASSERT_EQ(found.size(), points.size());
    EXPECT_FALSE(found.back());
    ASSERT_TRUE(found[0]);
    // The node (0, 0) is another than here.
    const int columns = nodes[0].node.column - found[0]->column,
              rows = nodes[0].node.row - found[0]->row;
    for (size_t i = 0; i < nodes.size(); ++i) {
      ASSERT_TRUE(found[i]);
      EXPECT_EQ(found[i]->column + columns, nodes[i].node.column);
      EXPECT_EQ(found[i]->row + rows, nodes[i].node.row);
    }
  }
}

TEST(LensLattice, IsThePolynomialOfItsNodes) {
  const auto place = [](double column, double row) -> Eigen::Vector2d {
    return {150 + 20 * column + 9 * row + 0.02 * column * column - 0.004 * row * row * column,
            120 + 17 * row - 0.3 * column + 0.03 * column * row + 0.002 * column * column * column};
  };
  const std::vector<LatticeMeasurement> nodes = Nodes(place);
  const SmoothLattice lattice = SmoothLattice::Fit(nodes);
  EXPECT_EQ(lattice.Degree(), 3);
  EXPECT_LT(lattice.Sigma(), 2e-4) << "the resolution";
  for (const auto& [column, row] : {std::pair(0.0, 0.0), {3.3, -2.6}, {-5.0, 4.2}}) {
    EXPECT_LT((lattice.Position(column, row) - place(column, row)).norm(), 1e-6);
    const Eigen::Matrix2d basis = lattice.Basis(column, row);
    EXPECT_NEAR(basis(0, 0), 20 + 0.04 * column - 0.004 * row * row, 1e-6);
    EXPECT_NEAR(basis(0, 1), 9 - 0.008 * row * column, 1e-6);
    EXPECT_NEAR(basis(1, 0), -0.3 + 0.03 * row + 0.006 * column * column, 1e-6);
    EXPECT_NEAR(basis(1, 1), 17 + 0.03 * column, 1e-6);
    const auto second = lattice.SecondDerivatives(column, row);
    EXPECT_LT((second[0] -
               (Eigen::Matrix2d() << 0.04, -0.008 * row, -0.008 * row, -0.008 * column).finished())
                  .norm(),
              1e-6);
    EXPECT_LT((second[1] - (Eigen::Matrix2d() << 0.012 * column, 0.03, 0.03, 0).finished()).norm(),
              1e-6);
    const Eigen::Vector2d back = lattice.Coordinates(place(column, row));
    EXPECT_LT((back - Eigen::Vector2d(column, row)).norm(), 1e-6);
  }
}

TEST(LensLattice, HasThePrecisionOfItsNodesAndNoOutliers) {
  constexpr double kNoise = 0.05;
  std::vector<LatticeMeasurement> nodes =
      Nodes([&](int column, int row) { return Bent(kHexagonal, column, row); });
  Random random(8);
  for (size_t i = 0; i < nodes.size(); ++i) {
    nodes[i].sigma = i % 2 == 0 ? 1 : 3;
    nodes[i].position += random.Gaussians<2>(kNoise * nodes[i].sigma);
    if (i % 9 == 4) nodes[i].position.x() += 6;
  }
  const SmoothLattice lattice = SmoothLattice::Fit(nodes);
  EXPECT_NEAR(lattice.Sigma(), kNoise, 0.2 * kNoise);
  EXPECT_LT((lattice.Position(0, 0) - Bent(kHexagonal, 0, 0)).norm(), 0.05);
}

TEST(LensLattice, NeedsSixNodes) {
  std::vector<LatticeMeasurement> nodes;
  for (int i = 0; i < 6; ++i) {
    nodes.push_back({.node = {i % 3, i / 3}, .position = Straight(kHexagonal, i % 3, i / 3)});
  }
  const SmoothLattice lattice = SmoothLattice::Fit(nodes);
  EXPECT_EQ(lattice.Degree(), 1);
  EXPECT_LT((lattice.Position(4, -2) - Straight(kHexagonal, 4, -2)).norm(), 1e-9);
  nodes.pop_back();
  EXPECT_THROW(SmoothLattice::Fit(nodes), Error);
}

TEST(LensLattice, GoesOnToTheImagesEdges) {
  const auto place = [](int column, int row) { return Bent(kHexagonal, column, row); };
  const std::vector<LatticeMeasurement> all = Nodes(place);
  std::vector<LatticeMeasurement> measured;
  for (const LatticeMeasurement& m : all) {
    if ((m.position - Eigen::Vector2d(150, 120)).norm() < 100) measured.push_back(m);
  }
  ASSERT_LT(measured.size(), all.size());
  const double cell = std::abs(kHexagonal.determinant());
  const SmoothLattice lattice = SmoothLattice::Fit(measured);
  const std::vector<LatticeNode> inside = lattice.NodesInside(measured, kSize, 0, cell);
  ASSERT_EQ(inside.size(), all.size());
  for (size_t i = 0; i < inside.size(); ++i) EXPECT_EQ(inside[i], all[i].node) << "by rows";
  EXPECT_GT(lattice.NodesInside(measured, kSize, 15, cell).size(), all.size() + 20);
}

// One row leaves the other lattice vector open: infinitely many nodes lie in the image.
TEST(LensLattice, OfOneRowIsRefused) {
  std::vector<LatticeMeasurement> nodes;
  for (int i = 0; i < 12; ++i) {
    nodes.push_back({.node = {i, 0}, .position = Straight(kHexagonal, i, 0)});
  }
  const SmoothLattice lattice = SmoothLattice::Fit(nodes);
  EXPECT_THAT(testing::RefusalOf([&] { (void)lattice.NodesInside(nodes, kSize, 15, 200); },
                                 ErrorKind::kJob),
              ::testing::HasSubstr("make no lattice"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
