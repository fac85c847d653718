// SPDX-License-Identifier: Apache-2.0
//
// Numbers and places of a target's file that the images contradict, at the limits of what counts.
// The board has 10 x 7 points, number 10 * row + column, 30 mm apart.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "assess/causes/cause.h"
#include "assess/causes/diagnose.h"
#include "tests/calib/synthetic.h"

namespace plenocal {

Cause WrongLayoutCause();

namespace testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;

constexpr double kSpacing = 0.03;

std::vector<Finding> FindLayout(const SyntheticProblem& problem, const TargetDoubts& doubts) {
  return WrongLayoutCause().find(
      {.inputs = &problem.input.cameras, .markers = &problem.input.markers, .doubts = &doubts});
}

TargetHypothesis Places(const CandidatePlaces& places) {
  return {.code = "target_layout", .what = "other", .remedy = "set it", .places = [places] {
            return places;
          }};
}

double SigmaIn(const Finding& finding) {
  return std::stod(finding.what.substr(finding.what.find("+- ") + 3));
}

// Pairs of columns, the pairs apart by a gap in units of `unit` spacings. The file states `stated`
// times the true gap.
TargetNumber StateAGap(SyntheticProblem* problem, double stated, double unit) {
  TargetNumber gap{.code = "target_spacing",
                   .key = "spacing",
                   .meaning = "gap",
                   .stated = stated / unit,
                   .least = 0.1 / unit,
                   .most = 4 / unit,
                   .by_number = {}};
  for (auto& [number, p] : problem->input.markers) {
    gap.by_number[number] = Eigen::Vector3d(unit * kSpacing * (number % 10 / 2), 0, 0);
    p += (stated - 1) / unit * gap.by_number[number];
  }
  return gap;
}

// With as many digits as its standard error leaves, none to six.
TEST(NumbersOfATarget, HaveTheDigitsThatTheImagesGive) {
  struct Case {
    double unit, stated;
    int digits;
    const char* file;
  };
  for (const Case& each : {Case{1 / 0.7, 0.93, 3, "0.651"},
                           Case{1 / 0.7, 1.07, 3, "0.749"},
                           Case{1e-4, 0.93, 0, "9300"},
                           Case{1e6, 0.93, 6, "9.3e-07"}}) {
    SyntheticProblem problem = MakeProblem(71, {.frames = 2, .noise = 0.1});
    const TargetNumber gap = StateAGap(&problem, each.stated, each.unit);
    const std::vector<Finding> found = FindLayout(problem, {{}, {gap}, {}});
    ASSERT_EQ(found.size(), 1U) << each.unit;
    EXPECT_NEAR(*found[0].value * each.unit, 1, 0.005) << each.unit;
    EXPECT_EQ(*found[0].limit, gap.stated);
    const std::string value = fmt::format("{:.{}f}", *found[0].value, each.digits);
    EXPECT_THAT(found[0].what, HasSubstr(" spacing (gap) of " + value + " +- "));
    EXPECT_THAT(found[0].what, EndsWith(fmt::format(" target's file states {}", each.file)));
    EXPECT_EQ(found[0].remedy, "set spacing: " + value + " in the target's file, or measure it");
    EXPECT_GT(SigmaIn(found[0]) * each.unit, 4e-4);
    EXPECT_LT(SigmaIn(found[0]) * each.unit, 2.5e-3);
  }
}

// 5 % of a gap, some 3 px, leave about 0.7 px in x beside a smooth map: 0.25 px^2 of a coordinate,
// as noise does. A standard error is 5 % / sqrt(0.65 * 210).
TEST(NumbersOfATarget, HaveStandardErrorsByNoise) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    SyntheticProblem problem = MakeProblem(seed, {.frames = 2, .noise = 0.5});
    const TargetNumber gap = StateAGap(&problem, seed % 2 == 0 ? 0.91 : 1.1, 1);
    const std::vector<Finding> found = FindLayout(problem, {{}, {gap}, {}});
    ASSERT_EQ(found.size(), 1U) << seed;
    EXPECT_NEAR(SigmaIn(found[0]), 0.0042, 0.0013);
    EXPECT_NEAR(*found[0].value, 1, 3 * SigmaIn(found[0]));
  }
}

// 7 % of a gap are residuals of about 1 px beside a smooth map: three times the variance of noise.
TEST(NumbersOfATarget, AreSoughtWhereTheyExplainTwoThirdsOfTheVariance) {
  for (const double stated : {0.93, 0.985, 1.015, 1.08}) {
    SyntheticProblem problem = MakeProblem(72, {.frames = 3, .noise = 0.5});
    const TargetNumber gap = StateAGap(&problem, stated, 1);
    const std::vector<Finding> found = FindLayout(problem, {{}, {gap}, {}});
    EXPECT_EQ(found.size(), std::abs(stated - 1) > 0.03 ? 1U : 0U) << stated;
    if (!found.empty()) {
      EXPECT_NEAR(*found[0].value, 1, 0.01) << stated;
    }
  }
}

// The file states rows of 7; the other places have errors.
TEST(PlacesOfATarget, FitToATwentiethOfTheSpacing) {
  for (const double error : {0.035, 0.07}) {
    SyntheticProblem problem = MakeProblem(73, {.frames = 2, .noise = 0.1});
    std::mt19937 random(1);
    std::normal_distribution<double> normal(0, error * kSpacing);
    CandidatePlaces places;
    for (auto& [number, p] : problem.input.markers) {
      places[number] = {p + Eigen::Vector3d(normal(random), normal(random), 0)};
      p = Eigen::Vector3d(kSpacing * (number % 7), kSpacing * (number / 7), 0);
    }
    EXPECT_EQ(FindLayout(problem, {{Places(places)}, {}, {}}).size(), error < 0.05 ? 1U : 0U)
        << error;
  }
}

// Each point is where its left or its right neighbour is said to be.
TEST(PlacesOfATarget, AreChosenByTheOtherPoints) {
  SyntheticProblem problem = MakeProblem(74, {.frames = 2, .noise = 0.1});
  CandidatePlaces places;
  for (auto& [number, p] : problem.input.markers) {
    const double side = number * 7 % 5 < 3 ? kSpacing : -kSpacing;
    places[number] = {p + Eigen::Vector3d(side, 0, 0), p - Eigen::Vector3d(side, 0, 0)};
    if (number % 2 == 0) std::swap(places[number][0], places[number][1]);
    p.x() += number % 3 == 0 ? side : -side;
  }
  const std::map<int, Eigen::Vector3d> truth = problem.markers;
  for (auto& [number, each] : places) {
    each[static_cast<size_t>(number) % 2] = truth.at(number);
  }
  const std::vector<Finding> found = FindLayout(problem, {{Places(places)}, {}, {}});
  ASSERT_THAT(CodesOf(found), ElementsAre("target_layout"));
  EXPECT_GT(*found[0].value, 50);
}

CandidatePlaces Alone(const std::map<int, Eigen::Vector3d>& markers) {
  CandidatePlaces places;
  for (const auto& [number, p] : markers) places[number] = {p};
  return places;
}

// With three stated points no camera can be guessed: they are taken to be off by a spacing.
TEST(PlacesOfASolid, AreTestedWhereTheStatedOnesGiveNoCamera) {
  SyntheticProblem problem =
      MakeProblem(75, {.shape = TargetShape::kCorner, .frames = 3, .noise = 0.1, .partial = 0.6});
  const std::map<int, Eigen::Vector3d> truth = problem.input.markers;
  problem.input.markers.erase(std::next(problem.input.markers.begin(), 3),
                              problem.input.markers.end());
  const std::vector<Finding> found = FindLayout(problem, {{Places(Alone(truth))}, {}, {}});
  ASSERT_EQ(found.size(), 1U);
  // Some 50 px in place of 0.1 px.
  EXPECT_GT(*found[0].value, 300);
  EXPECT_LT(*found[0].value, 800);
}

// Errors of the file as large as the noise, or nearly twice: decisive with 150 points (a ratio of
// variances of 2 would do), not with 40 (4.1).
TEST(PlacesOfASolid, NeedPointsToBeBetterByChanceOnceInAMillion) {
  for (const double partial : {0.75, 0.93}) {
    SyntheticProblem problem = MakeProblem(
        76, {.shape = TargetShape::kCorner, .frames = 3, .noise = 1.5, .partial = partial});
    const std::map<int, Eigen::Vector3d> truth = problem.input.markers;
    std::mt19937 random(2);
    std::normal_distribution<double> normal(0, 0.0014);
    for (auto& [number, p] : problem.input.markers) {
      p += Eigen::Vector3d(normal(random), normal(random), normal(random));
    }
    EXPECT_EQ(FindLayout(problem, {{Places(Alone(truth))}, {}, {}}).size(),
              partial < 0.9 ? 1U : 0U);
  }
}

}  // namespace TEST_FILE
}  // namespace testing
}  // namespace plenocal
