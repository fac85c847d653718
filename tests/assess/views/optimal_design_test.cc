// SPDX-License-Identifier: Apache-2.0
#include "assess/views/optimal_design.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <functional>
#include <limits>
#include <random>

namespace plenocal::testing {
namespace TEST_FILE {

constexpr Eigen::Index kUnknowns = 4, kViews = 7;

Eigen::MatrixXd Random(std::mt19937* dice, Eigen::Index columns) {
  std::normal_distribution<double> normal;
  return Eigen::MatrixXd::NullaryExpr(kUnknowns, columns, [&] { return normal(*dice); });
}

struct Problem {
  Eigen::MatrixXd M, so_far, views;

  explicit Problem(unsigned seed) {
    std::mt19937 dice(seed);
    const Eigen::MatrixXd of_image = Random(&dice, 3);
    M = of_image * of_image.transpose();
    so_far = 0.1 * Eigen::MatrixXd::Identity(kUnknowns, kUnknowns);
    views.resize(kUnknowns * (kUnknowns + 1) / 2, kViews);
    for (Eigen::Index i = 0; i < kViews; ++i) {
      const Eigen::MatrixXd rows = Random(&dice, 2);
      views.col(i) = Packed(rows * rows.transpose());
    }
  }

  // The least trace of all choices of whole numbers of views.
  [[nodiscard]] double Least(int count, Eigen::Index first, const Eigen::MatrixXd& S) const {
    if (count == 0) return S.llt().solve(M).trace();
    double least = std::numeric_limits<double>::infinity();
    for (Eigen::Index i = first; i < kViews; ++i) {
      least = std::min(least, Least(count - 1, i, S + Unpacked(views.col(i))));
    }
    return least;
  }
};

TEST(OptimalDesign, PacksTheProductOfMatrices) {
  std::mt19937 dice(1);
  const Eigen::MatrixXd a = Random(&dice, 4), b = Random(&dice, 4);
  const Eigen::MatrixXd A = a + a.transpose(), B = b * b.transpose();
  EXPECT_EQ(Packed(A).size(), 10);
  EXPECT_EQ(Unpacked(Packed(A)), A);
  EXPECT_NEAR(PackedTwice(A).dot(Packed(B)), (A * B).trace(), 1e-12);
}

TEST(OptimalDesign, BoundsEveryChoiceOfViews) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const Problem problem(seed);
    double before = std::numeric_limits<double>::infinity();
    for (const int count : {1, 2, 3, 5}) {
      const OptimalDesign design = SolveDesign(problem.M, problem.so_far, problem.views, count, {});
      const double least = problem.Least(count, 0, problem.so_far);
      const double bound = design.LeastTrace(count);
      EXPECT_LE(bound, least * (1 + 1e-12));
      EXPECT_LE(design.trace, 1.0031 * bound) << "its own gap is certified";
      EXPECT_NEAR(design.weights.sum(), count, 1e-9);
      EXPECT_LT(bound, before) << "more views reach more";
      // The bound of one number of views bounds others.
      for (const int other : {1, 4}) {
        EXPECT_LE(design.LeastTrace(other), problem.Least(other, 0, problem.so_far));
      }
      EXPECT_LE(design.FewestViews(least), count * (1 + 1e-12));
      EXPECT_GE(design.FewestViews(bound), count * (1 - 1e-12));
      before = bound;
    }
  }
}

TEST(OptimalDesign, HasNoNumberOfViewsThatAddNothing) {
  Problem problem(1);
  problem.views.setZero();
  const OptimalDesign design = SolveDesign(problem.M, problem.so_far, problem.views, 3, {});
  const double now = problem.Least(0, 0, problem.so_far);
  EXPECT_NEAR(design.LeastTrace(3), now, 1e-12 * now);
  EXPECT_TRUE(std::isinf(design.FewestViews(now / 2)));
  EXPECT_EQ(design.FewestViews(2 * now), 0);
  EXPECT_NEAR(design.weights.sum(), 3, 1e-9);
  // The same from an earlier solution, of one view alone.
  const Eigen::VectorXd start = Eigen::VectorXd::Constant(1, 2);
  const Eigen::VectorXd first = 3 * Eigen::VectorXd::Unit(kViews, 0);
  EXPECT_EQ(SolveDesign(problem.M, problem.so_far, problem.views, 3, start).weights, first);
  OptimalDesign reached;
  reached.trace = 2, reached.of_so_far = 4;
  EXPECT_EQ(reached.FewestViews(1), 0);
}

TEST(OptimalDesign, KeepsAnEarlierSolutionAndAddsViewsToIt) {
  const Problem problem(3);
  const OptimalDesign design = SolveDesign(problem.M, problem.so_far, problem.views, 4, {});
  const Eigen::VectorXd half = design.weights / 2;
  const OptimalDesign again = SolveDesign(problem.M, problem.so_far, problem.views, 4, half);
  EXPECT_LT((again.weights - design.weights).norm(), 1e-12);
  const Eigen::MatrixXd few = problem.views.rightCols(3);
  const Eigen::VectorXd start = SolveDesign(problem.M, problem.so_far, few, 4, {}).weights;
  Eigen::MatrixXd all(few.rows(), kViews);
  all << few, problem.views.leftCols(kViews - 3);
  const OptimalDesign more = SolveDesign(problem.M, problem.so_far, all, 4, start);
  EXPECT_LE(more.trace, 1.0031 * design.LeastTrace(4));
  EXPECT_NEAR(more.weights.sum(), 4, 1e-9);
}

// Of many views thirty are weighted at once, the steepest: here the last two alone are of use.
TEST(OptimalDesign, FindsTheFewGoodOnesOfManyViews) {
  const Problem problem(2);
  Eigen::MatrixXd views(problem.views.rows(), 60);
  for (Eigen::Index i = 0; i < 60; ++i) {
    views.col(i) = (i < 58 ? 1e-4 * (i + 1) : 1.0) * problem.views.col(i % 2);
  }
  const OptimalDesign design = SolveDesign(problem.M, problem.so_far, views, 5, {});
  EXPECT_LE(design.trace, 1.0031 * design.LeastTrace(5));
  EXPECT_EQ((design.weights.array() > 0).count(), 30);
  EXPECT_GT(design.weights.tail(2).sum(), 4.9);
  // What an earlier solution has of the others goes.
  Eigen::VectorXd start = Eigen::VectorXd::Constant(58, 1e-5);
  start[57] = 1;
  const OptimalDesign later = SolveDesign(problem.M, problem.so_far, views, 5, start);
  EXPECT_LE(later.trace, 1.0031 * design.LeastTrace(5));
  EXPECT_NEAR(later.weights.sum(), 5, 1e-9);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
