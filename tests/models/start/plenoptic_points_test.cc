// SPDX-License-Identifier: Apache-2.0
#include "models/start/plenoptic_points.h"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <set>

#include "calib/camera/lens_lattice.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

using Eigen::Vector2d;
using ::testing::HasSubstr;

using Pointers = std::vector<const Observation*>;

Pointers PointersTo(const std::vector<Observation>& seen) {
  Pointers pointers;
  for (const Observation& each : seen) pointers.push_back(&each);
  return pointers;
}

Observation Seen(const Vector2d& x, const Vector2d& c) {
  return {.marker = 1, .values = {x.x(), x.y(), c.x(), c.y()}};
}

/// Points u_0 + s c with errors of about a pixel.
std::vector<Observation> RoughPoints(int count, unsigned seed) {
  Random random(seed);
  std::vector<Observation> seen;
  for (int i = 0; i < count; ++i) {
    const Vector2d c = random.Uniforms<2>(300, 400);
    seen.push_back(Seen(Vector2d(70, -20) + 0.7 * c + random.Uniforms<2>(-1, 1), c));
  }
  return seen;
}

/// Rows of the unknowns u_0x, u_0y and s.
Eigen::MatrixXd RowsOf(const std::vector<Observation>& seen) {
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(2 * static_cast<Eigen::Index>(seen.size()), 3);
  for (Eigen::Index i = 0; i < rows.rows(); ++i) {
    rows(i, i % 2) = 1;
    rows(i, 2) = seen[static_cast<size_t>(i / 2)].values[static_cast<size_t>(2 + i % 2)];
  }
  return rows;
}

TEST(MicroImages, LeaveTheResidualsOfAWeightedLineWithOneSlope) {
  const std::vector<Observation> seen = RoughPoints(6, 1);
  const std::vector<double> weights{1, 0.5, 2, 3, 0.25, 1.5};
  std::vector<ReplicateResidual> residuals(seen.size());
  FitMicroImages(PointersTo(seen), weights, residuals.data());

  const Eigen::MatrixXd rows = RowsOf(seen);
  Eigen::VectorXd W(rows.rows()), x(rows.rows());
  for (Eigen::Index i = 0; i < rows.rows(); ++i) {
    W[i] = weights[static_cast<size_t>(i / 2)];
    x[i] = seen[static_cast<size_t>(i / 2)].values[static_cast<size_t>(i % 2)];
  }
  const Eigen::MatrixXd solve =
      (rows.transpose() * W.asDiagonal() * rows).inverse() * rows.transpose() * W.asDiagonal();
  const Eigen::VectorXd left = x - rows * (solve * x);
  const Eigen::VectorXd share = (rows * solve).diagonal();
  double redundancy = 0;
  for (size_t i = 0; i < seen.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(2 * i);
    EXPECT_NEAR(residuals[i].squared, left.segment<2>(k).squaredNorm(), 1e-9) << i;
    EXPECT_NEAR(residuals[i].redundancy, 2 - share[k] - share[k + 1], 1e-9) << i;
    redundancy += residuals[i].redundancy;
  }
  EXPECT_NEAR(redundancy, 2.0 * 6 - 3, 1e-9);
}

TEST(MicroImages, OfOneCentreLeaveNothing) {
  const std::vector<Observation> seen{Seen({1, 2}, {30, 40}), Seen({5, 9}, {30, 40})};
  for (const size_t count : {1U, 2U}) {
    std::vector<ReplicateResidual> residuals(count, {7, 7});
    Pointers pointers = PointersTo(seen);
    pointers.resize(count);
    FitMicroImages(pointers, std::vector<double>{1, 1}, residuals.data());
    for (const ReplicateResidual& each : residuals) {
      EXPECT_EQ(each.squared, 0);
      EXPECT_EQ(each.redundancy, 0);
    }
  }
}

/// Points u_0 + (1 - 1 / v) c, displaced as templates of depth v_t are, by some `largest` px.
std::vector<Observation> ByTemplates(double v,
                                     const Vector2d& principal,
                                     const Eigen::Vector4d& T,
                                     double largest = 3) {
  Random random(3);
  std::vector<Observation> seen;
  for (int i = 0; i < 7; ++i) {
    const Vector2d c = random.Uniforms<2>(300, 400),
                   by_depth = random.Uniforms<2>(-largest, largest);
    const double v_t = i == 2 ? 0 : random.Uniform(1, 5);  // 0: no template
    const Vector2d x = Vector2d(70, -20) + (1 - 1 / v) * c;
    const Vector2d bend = ThirdOrderTerms(c - principal, x - c) * T;
    const Vector2d shown = x + bend - (v_t == 0 ? 0 : 1 - v_t / v) * by_depth;
    Observation& each = seen.emplace_back(Seen(shown, c));
    each.values[4] = v_t;
    each.values[5] = by_depth.x();
    each.values[6] = by_depth.y();
  }
  return seen;
}

TEST(MicroImages, OfTemplatesOfAWrongDepthAreOnTheLine) {
  const std::vector<Observation> seen = ByTemplates(3.7, {0, 0}, Eigen::Vector4d::Zero());
  std::vector<ReplicateResidual> residuals(seen.size());
  FitMicroImages(PointersTo(seen), std::vector<double>(seen.size(), 1.0), residuals.data());
  for (const ReplicateResidual& each : residuals) EXPECT_NEAR(each.squared, 0, 1e-18);
  const Eigen::MatrixXd terms = ThirdOrderOfMicroImages({350, 350}, PointersTo(seen));
  ASSERT_EQ(terms.cols(), 5);
  EXPECT_LT(terms.col(0).norm(), 1e-9);
}

TEST(ThirdOrder, HasTheTermsOfSphericalAberrationComaAstigmatismAndField) {
  const Vector2d c(3, -2), d(0.5, 4);
  const double cd = 3 * 0.5 - 2 * 4, d2 = 0.25 + 16, c2 = 9 + 4;
  const Eigen::Matrix<double, 2, 4> terms = ThirdOrderTerms(c, d);
  for (int i = 0; i < 2; ++i) {
    EXPECT_DOUBLE_EQ(terms(i, 0), d2 * d[i]);
    EXPECT_DOUBLE_EQ(terms(i, 1), 2 * cd * d[i] + d2 * c[i]);
    EXPECT_DOUBLE_EQ(terms(i, 2), cd * c[i]);
    EXPECT_DOUBLE_EQ(terms(i, 3), c2 * d[i]);
  }
}

TEST(ThirdOrder, IsWhatALineLeavesOfBentPoints) {
  const Vector2d principal(340, 360);
  for (int k = 0; k < 4; ++k) {
    Eigen::Vector4d T = Eigen::Vector4d::Zero();
    T[k] = 1e-9;
    const std::vector<Observation> seen = ByTemplates(3.7, principal, T, 0.003);
    const Eigen::MatrixXd left = ThirdOrderOfMicroImages(principal, PointersTo(seen));
    ASSERT_EQ(left.rows(), 14);
    ASSERT_EQ(left.cols(), 5);
    const Eigen::VectorXd explained = left.rightCols<4>() * T;
    EXPECT_GT(explained.norm(), 1e-7) << k;
    // The terms are at the fitted places, which bend and templates move a little.
    EXPECT_LT((left.col(0) - explained).norm(), 1e-3 * explained.norm()) << k;
  }
  const std::vector<Observation> one{Seen({1, 2}, {30, 40})};
  EXPECT_EQ(ThirdOrderOfMicroImages(principal, PointersTo(one)).size(), 0);
  const std::vector<Observation> same{Seen({1, 2}, {30, 40}), Seen({1, 3}, {30, 40})};
  EXPECT_EQ(ThirdOrderOfMicroImages(principal, PointersTo(same)).size(), 0);
}

// ---- lens types

struct Array {
  int side = 14;
  double angle = 0.3, second = std::numbers::pi / 3;
  std::array<double, 3> sigma{0.1, 0.2, 0.3};
};

/// Views of markers, each seen by all lenses of an array; `sets` receives the set of each.
std::vector<View> ViewsThrough(const Array& array, std::vector<int>* sets) {
  constexpr double kPitch = 20;
  Random random(8);
  std::vector<View> views(2);
  for (int marker = 0; marker < 2; ++marker) {
    for (View& view : views) {
      for (int i = -array.side; i < array.side; ++i) {
        for (int j = -array.side; j < array.side; ++j) {
          if (i * i + i * j + j * j > array.side * array.side) continue;
          const Vector2d c = kPitch * (i * Vector2d(std::cos(array.angle), std::sin(array.angle)) +
                                       j * Vector2d(std::cos(array.angle + array.second),
                                                    std::sin(array.angle + array.second)));
          const int set = kThreeInterleaved.Set({i, j});
          const double sigma = array.sigma[static_cast<size_t>(set)];
          Observation seen = Seen(
              Vector2d(5, 6) + 0.6 * c + Vector2d(random.Gaussian(sigma), random.Gaussian(sigma)),
              c);
          seen.marker = marker;
          seen.lens_type = 9;
          view.observations.push_back(seen);
          sets->push_back(set);
        }
      }
    }
  }
  return views;
}

/// The types that were found beside each set of the array.
std::set<std::pair<int, int>> FoundTypes(const Array& array, std::set<int>* types = nullptr) {
  std::vector<int> sets;
  std::vector<View> views = ViewsThrough(array, &sets);
  FindLensTypes(&views);
  std::set<std::pair<int, int>> found;
  // `sets` is by marker, then by view.
  const size_t per = views[0].observations.size() / 2;
  for (size_t marker = 0; marker < 2; ++marker) {
    for (size_t v = 0; v < 2; ++v) {
      for (size_t i = 0; i < per; ++i) {
        const int type = views[v].observations[marker * per + i].lens_type;
        found.emplace(sets[(2 * marker + v) * per + i], type);
        if (types != nullptr) types->insert(type);
      }
    }
  }
  return found;
}

TEST(LensTypes, AreTheThreeSetsOfAHexagonalArrayWhoseNoiseDiffers) {
  for (const double angle : {0.0, 0.3, 1.0, -0.5, 2.6}) {
    for (const double second : {std::numbers::pi / 3, -std::numbers::pi / 3}) {
      // A set has one type, and a type one set.
      std::set<int> types;
      EXPECT_EQ(FoundTypes({.side = 7, .angle = angle, .second = second}, &types).size(), 3U)
          << angle;
      EXPECT_THAT(types, ::testing::ElementsAre(0, 1, 2));
    }
  }
}

TEST(LensTypes, AreOneWhereTheNoiseIsOne) {
  std::set<int> types;
  FoundTypes({.side = 7, .sigma = {0.2, 0.2, 0.2}}, &types);
  EXPECT_THAT(types, ::testing::ElementsAre(0));
  FoundTypes({.side = 7, .sigma = {0.2, 0.2, 0.15}}, &types);
  EXPECT_EQ(types.size(), 3U);
}

TEST(LensTypes, StayWhereTheCentresAreNoHexagonalArray) {
  std::set<int> types;
  FoundTypes({.side = 7, .second = std::numbers::pi / 2}, &types);
  EXPECT_THAT(types, ::testing::ElementsAre(9));
  types.clear();
  FoundTypes({.side = 4}, &types);  // fewer than 100 lenses
  EXPECT_THAT(types, ::testing::ElementsAre(9));
}

TEST(LensTypes, OfIslandsOfLensesAreCountedFromTheNearest) {
  std::vector<int> sets;
  std::vector<View> views = ViewsThrough({.side = 9}, &sets);
  // A ring of lenses is missing, as between two markers.
  const auto missing = [](const Observation& seen) {
    const double r = std::hypot(seen.values[2], seen.values[3]);
    return r > 85 && r < 123;
  };
  const size_t per = views[0].observations.size() / 2;
  std::set<std::pair<int, int>> found;
  std::vector<std::vector<int>> kept(2);
  for (size_t v = 0; v < 2; ++v) {
    std::vector<Observation> left;
    for (size_t k = 0; k < 2 * per; ++k) {
      const Observation& seen = views[v].observations[k];
      if (missing(seen)) continue;
      left.push_back(seen);
      kept[v].push_back(sets[(2 * (k / per) + v) * per + k % per]);
    }
    views[v].observations = left;
  }
  FindLensTypes(&views);
  for (size_t v = 0; v < 2; ++v) {
    for (size_t k = 0; k < kept[v].size(); ++k) {
      found.emplace(kept[v][k], views[v].observations[k].lens_type);
    }
  }
  EXPECT_EQ(found.size(), 3U);
}

// ---- remedies

TEST(PlenopticRemedy, NamesWhatEachParameterNeeds) {
  const DepthRange narrow{1.0, 1.5}, wide{0.5, 4.0};
  const auto remedy = [](std::vector<size_t> weak,
                         const DepthRange& seen,
                         std::optional<size_t> tilt = std::nullopt) {
    return PlenopticRemedy(weak, 20, tilt, seen);
  };
  // Of 1.0 to 1.5 m the geometric mean is 1.225 m, which times and over sqrt(3) is 2.1 and 0.71 m.
  const std::string near =
      "f_L, b_L0 and B follow from how the virtual depth changes with distance, "
      "and the target was seen from 1 to 1.5 m only: add views between 0.71 "
      "and 2.1 m, tilted ones too, or hold f_L from the data sheet (initial: "
      "{f_L: ...}, fixed: [f_L]).";
  const std::string far =
      "f_L, b_L0 and B follow from how the virtual depth changes with distance, "
      "and the target was seen from 0.5 to 4 m only: add tilted views and views "
      "at both ends of that range, or hold f_L from the data sheet (initial: "
      "{f_L: ...}, fixed: [f_L]).";
  for (const size_t k : {0U, 1U, 2U, 20U}) {
    EXPECT_EQ(remedy({k}, narrow), near);
    EXPECT_EQ(remedy({k}, wide), far);
  }
  EXPECT_EQ(remedy({}, narrow), "");
  for (const size_t k : {9U, 19U, 21U}) EXPECT_EQ(remedy({k}, narrow), "");
  const std::string centre =
      "The principal point trades against the target's tilt: add views tilted "
      "by 30 degrees or more about both axes and some turned by 90 degrees.";
  for (const size_t k : {3U, 4U}) EXPECT_EQ(remedy({k}, narrow), centre);
  const std::string radial =
      "The radial terms A_0, A_1 need points over the whole image: add views "
      "with the target in each corner, or hold A_1 (fixed: [A_1]).";
  for (const size_t k : {5U, 6U}) EXPECT_EQ(remedy({k}, narrow), radial);
  const std::string tangential =
      "The tangential terms B_0, B_1 trade against the principal point and the target's tilt: add "
      "views tilted by 30 degrees or more about both axes, or hold them (fixed: [B_0, B_1]).";
  for (const size_t k : {7U, 8U}) EXPECT_EQ(remedy({k}, narrow), tangential);
  const std::string tilted =
      "The array's tilt t_x, t_y changes B over the image: add near and far views with the target "
      "in each corner, or hold it (fixed: [t_x, t_y]).";
  for (const size_t k : {30U, 31U}) EXPECT_EQ(remedy({k}, narrow, 30), tilted);
  for (const size_t k : {29U, 32U}) EXPECT_EQ(remedy({k}, narrow, 30), "");
  EXPECT_EQ(remedy({3, 5}, narrow), centre + " " + radial);
  EXPECT_EQ(remedy({3, 7, 30}, narrow, 30), tangential + " " + tilted);
}

TEST(PlenopticRemedy, AsksForDepthsWhereTheyReachAFifthFarther) {
  // For a range of r to one, the proposed one reaches sqrt(3 / r) farther at either end.
  const auto asks_for_depths = [](double ratio) {
    const std::string text = PlenopticRemedy(std::vector<size_t>{0}, 20, {}, {1.0, ratio});
    return text.find("add views between") != std::string::npos;
  };
  constexpr double kLimit = 3 / 1.44;
  EXPECT_TRUE(asks_for_depths(0.99 * kLimit));
  EXPECT_FALSE(asks_for_depths(1.01 * kLimit));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
