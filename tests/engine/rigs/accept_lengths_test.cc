// SPDX-License-Identifier: Apache-2.0
//
// Deviations of lengths, their joint covariance, and what a complete test needs, against formulas.
#include "engine/rigs/accept_lengths.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "calib/base/statistics.h"
#include "tests/calib/random.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

SpacePoint PointAt(const Eigen::Vector3d& position, double sigma, Eigen::Index columns = 1) {
  SpacePoint point;
  point.position = position;
  point.rho = 1;
  point.noise = sigma * sigma * Eigen::Matrix3d::Identity();
  point.shared = Eigen::MatrixXd::Zero(3, columns);
  return point;
}

ScenePosition End(std::vector<int> numbers) {
  return {.name = fmt::format("p{}", numbers[0]), .points = std::move(numbers)};
}

ReferenceLength Bar(int a, int b, double length, const std::string& line = "row") {
  return {.line = line, .a = End({a}), .b = End({b}), .length = length};
}

AcceptanceTest Simple(std::vector<ReferenceLength> lengths) {
  AcceptanceTest test;
  test.constant = 0.01;
  test.guarded = false;
  test.lengths = std::move(lengths);
  return test;
}

// Points 0, 1, ... on the x axis of one frame.
Triangulation OnAxis(const std::vector<double>& x, double sigma) {
  Triangulation made;
  for (size_t i = 0; i < x.size(); ++i) {
    made.points.push_back({.frame = "f1",
                           .marker = static_cast<int>(i),
                           .point = PointAt({x[i], 0, 2}, sigma),
                           .used = true});
  }
  return made;
}

TEST(AcceptLengths, LimitsGrowWithTheLengthUpToTheMostAndLoseTheReferencesError) {
  struct Case {
    std::optional<double> at_most;
    bool guarded;
    double length, sigma, limit;
  };
  for (const Case& each : {Case{{}, false, 0.5, 1e-4, 2e-3},
                           Case{{}, true, 0.5, 1e-4, 1.8e-3},
                           Case{1.5e-3, false, 0.5, 1e-4, 1.5e-3},
                           Case{1.5e-3, true, 0.5, 1e-4, 1.3e-3},
                           Case{2.5e-3, false, 0.5, 0, 2e-3},
                           Case{{}, true, 0, 6e-4, 0},
                           Case{{}, true, 0, 4e-4, 2e-4}}) {
    const AcceptanceTest test{.constant = 1e-3,
                              .per_metre = 2e-3,
                              .at_most = each.at_most,
                              .guarded = each.guarded,
                              .lengths = {}};
    ReferenceLength length = Bar(0, 1, each.length);
    length.sigma = each.sigma;
    EXPECT_NEAR(test.LimitOf(length), each.limit, 1e-15);
  }
}

TEST(AcceptLengths, ADeviationPassesUpToItsLimitOnBothSides) {
  ReferenceLength reference = Bar(0, 1, 1);
  reference.sigma = 3;
  for (const double sign : {-1.0, 1.0}) {
    AcceptedLength length{.reference = &reference,
                          .frame = "f",
                          .measured = 1 + sign * 0.5,
                          .sigma = 4,
                          .limit = 0.5};
    EXPECT_EQ(length.Deviation(), sign * 0.5);
    EXPECT_EQ(length.InSigmas(), sign * 0.1);
    EXPECT_TRUE(length.Passes());
    length.limit = 0.499;
    EXPECT_FALSE(length.Passes());
  }
  EXPECT_EQ(reference.Of(), "p0 - p1");
}

TEST(AcceptLengths, ReadTheWholeFile) {
  const TemporaryFolder folder;
  const AcceptanceTest test = ReadAcceptanceTest(
      folder.Write("bars.yaml",
                   "plenocal: 1\nlimit: {constant: 50 um, per_metre: 0.1 mm, at_most: 0.2 mm}\n"
                   "decision: simple\nmode: bundle\n"
                   "temperature: {bar: 23.5, calibrated: 20, expansion: 1e-4}\n"
                   "lines:\n"
                   "  - {name: row, bars: [{between: [tag 3, 7], length: 500 mm, sigma: 2 um}]}\n"
                   "  - {name: other, bars: [{between: [1, tag 2 corner 3], length: 1 m}]}\n"));
  EXPECT_NEAR(test.constant, 50e-6, 1e-15);
  EXPECT_NEAR(test.per_metre, 1e-4, 1e-15);
  EXPECT_NEAR(test.at_most.value(), 2e-4, 1e-15);
  EXPECT_FALSE(test.guarded);
  EXPECT_TRUE(test.bundle);
  ASSERT_EQ(test.lengths.size(), 2U);
  EXPECT_EQ(test.lengths[0].line, "row");
  EXPECT_EQ(test.lengths[0].Of(), "tag 3 - 7");
  EXPECT_THAT(test.lengths[0].a.points, ElementsAre(12, 13, 14, 15));
  EXPECT_THAT(test.lengths[0].b.points, ElementsAre(7));
  EXPECT_NEAR(test.lengths[0].length, 0.5 * 1.00035, 1e-12);
  EXPECT_NEAR(test.lengths[0].sigma, 2e-6, 1e-15);
  EXPECT_THAT(test.lengths[1].b.points, ElementsAre(11));
  EXPECT_EQ(test.lengths[1].sigma, 0);
}

TEST(AcceptLengths, AShortFileIsGuardedAndJudgesEachFrame) {
  const TemporaryFolder folder;
  const std::string rest =
      "plenocal: 1\nlimit: {constant: 1 mm}\n"
      "lines: [{name: a, bars: [{between: [0, 1], length: 1}]}]\n";
  AcceptanceTest test = ReadAcceptanceTest(folder.Write("bars.yaml", rest));
  EXPECT_TRUE(test.guarded);
  EXPECT_FALSE(test.bundle);
  EXPECT_EQ(test.per_metre, 0);
  EXPECT_FALSE(test.at_most);
  EXPECT_EQ(test.lengths.at(0).length, 1);
  test = ReadAcceptanceTest(folder.Write("bars.yaml", rest + "decision: guarded\nmode: single\n"));
  EXPECT_TRUE(test.guarded);
  EXPECT_FALSE(test.bundle);
}

TEST(AcceptLengths, FilesThatDoNotFitAreRefused) {
  const TemporaryFolder folder;
  const std::string limit = "plenocal: 1\nlimit: {constant: 1 mm}\n",
                    lines = "lines: [{name: a, bars: [{between: [0, 1], length: 1}]}]\n";
  const auto refused = [&](const std::string& text) {
    const auto file = folder.Write("bars.yaml", text);
    std::string why = Refusal([&] { ReadAcceptanceTest(file); });
    const size_t at = why.find(file.string());
    return at == std::string::npos ? why : why.erase(at, file.string().size());
  };
  EXPECT_EQ(refused(limit + "lines: []\n"), "input: :3:8: lines: no line has a bar");
  EXPECT_EQ(refused(limit + lines + "decision: kind\n"),
            "input: :4:11: decision: expected guarded or simple, found 'kind'");
  EXPECT_EQ(refused(limit + lines + "mode: all\n"),
            "input: :4:7: mode: expected single or bundle, found 'all'");
  EXPECT_THAT(refused(limit + "lines: [{name: a, bars: [{between: [0, 1, 2], length: 1}]}]\n"),
              ::testing::EndsWith("between: expected two ends, as [tag 3, tag 7]"));
  EXPECT_THAT(refused(limit + "lines: [{name: a, bars: [{between: [4, 4], length: 1}]}]\n"),
              ::testing::EndsWith("between: both ends are the same"));
  EXPECT_THAT(refused(limit + "lines: [{name: a, bars: []}, {name: a, bars: []}]\n"),
              ::testing::EndsWith("name: stands twice"));
  EXPECT_THAT(refused(limit + "lines: [{name: a, bars: [{between: [0, tug 1], length: 1}]}]\n"),
              ::testing::EndsWith("'tug 1' is no point: expected its number, 'tag ID' or 'tag ID "
                                  "corner 0' to 3"));
  const std::string bar = "between: [0, 1], length: 1";
  for (const std::string& wrong :
       {limit + lines + "wrong: 1\n",
        limit + lines + "temperature: {bar: 1, calibrated: 2, expansion: 1e-6, wrong: 1}\n",
        "plenocal: 1\nlimit: {constant: 1 mm, wrong: 2 mm}\n" + lines,
        limit + "lines: [{name: a, wrong: 1, bars: [{" + bar + "}]}]\n",
        limit + "lines: [{name: a, bars: [{wrong: 1, " + bar + "}]}]\n"}) {
    EXPECT_THAT(refused(wrong), ::testing::HasSubstr("wrong: unknown key")) << wrong;
  }
  const std::string temperature = limit + lines + "temperature: ";
  EXPECT_THAT(refused(temperature + "{calibrated: 20, expansion: 1e-6}\n"),
              ::testing::HasSubstr("bar: 23.5"));
  EXPECT_THAT(refused(temperature + "{bar: 20, expansion: 1e-6}\n"),
              ::testing::HasSubstr("calibrated: 20"));
  EXPECT_THAT(refused(temperature + "{bar: 20, calibrated: 20}\n"),
              ::testing::HasSubstr("expansion: 1.2e-6"));
  EXPECT_THAT(refused(limit), ::testing::HasSubstr("between: [tag 3, tag 7], length: 499.962 mm"));
}

// Two frames of six points with errors of all kinds; one bar ends in the mean of two points.
struct Simulated {
  AcceptanceTest test;
  Triangulation made;
};

Simulated WithAllErrors() {
  Random random(3);
  Simulated all;
  for (const char* frame : {"f1", "f2"}) {
    for (int marker = 0; marker < 6; ++marker) {
      SpacePoint point = PointAt(random.Uniforms<3>(-1, 1), 0, 5);
      Eigen::Matrix3d root;
      for (Eigen::Index i = 0; i < 9; ++i) root(i / 3, i % 3) = random.Gaussian(2e-3);
      point.noise = root * root.transpose();
      for (Eigen::Index i = 0; i < 15; ++i) point.shared(i / 5, i % 5) = random.Gaussian(1e-3);
      point.frame_columns = 2;
      all.made.points.push_back({.frame = frame, .marker = marker, .point = point, .used = true});
    }
  }
  all.test = Simple({Bar(0, 1, 1), Bar(1, 5, 0.7), Bar(2, 3, 1.2)});
  all.test.lengths[2].b = End({3, 4});
  for (ReferenceLength& each : all.test.lengths) each.sigma = 1e-3;
  return all;
}

double LengthIn(const Simulated& all, size_t frame, const ReferenceLength& bar) {
  const auto mean = [&](const ScenePosition& end) -> Eigen::Vector3d {
    Eigen::Vector3d sum(0, 0, 0);
    for (const int k : end.points) {
      sum += all.made.points[6 * frame + static_cast<size_t>(k)].point.position;
    }
    return sum / static_cast<double>(end.points.size());
  };
  return (mean(bar.a) - mean(bar.b)).norm();
}

// By numeric derivatives of all lengths and the covariance of all coordinates.
TEST(AcceptLengths, TheJointTestHasTheCovarianceOfAllCoordinates) {
  Simulated all = WithAllErrors();
  constexpr Eigen::Index kCoordinates = 36;
  Eigen::MatrixXd coordinates(kCoordinates, kCoordinates), by(6, kCoordinates);
  for (Eigen::Index i = 0; i < 12; ++i) {
    const SpacePoint& a = all.made.points[static_cast<size_t>(i)].point;
    for (Eigen::Index j = 0; j < 12; ++j) {
      const SpacePoint& b = all.made.points[static_cast<size_t>(j)].point;
      Eigen::Matrix3d block = a.shared.leftCols(3) * b.shared.leftCols(3).transpose();
      if (i / 6 == j / 6) block += a.shared.rightCols(2) * b.shared.rightCols(2).transpose();
      if (i == j) block += a.noise;
      coordinates.block<3, 3>(3 * i, 3 * j) = block;
    }
  }
  // Rows in the order of the result: by bar, then frame.
  constexpr double kStep = 1e-6;
  Eigen::VectorXd deviation(6), length(6);
  for (Eigen::Index row = 0; row < 6; ++row) {
    const ReferenceLength& bar = all.test.lengths[static_cast<size_t>(row / 2)];
    const auto frame = static_cast<size_t>(row % 2);
    length[row] = bar.length;
    deviation[row] = LengthIn(all, frame, bar) - bar.length;
    for (Eigen::Index k = 0; k < kCoordinates; ++k) {
      double& x = all.made.points[static_cast<size_t>(k / 3)].point.position[k % 3];
      const double before = std::exchange(x, x + kStep);
      const double above = LengthIn(all, frame, bar);
      x = before - kStep;
      by(row, k) = (above - LengthIn(all, frame, bar)) / (2 * kStep);
      x = before;
    }
  }
  Eigen::MatrixXd covariance = by * coordinates * by.transpose();
  const Eigen::VectorXd own = covariance.diagonal();
  for (Eigen::Index row = 0; row < 6; ++row) {
    covariance.block<2, 2>(row / 2 * 2, row / 2 * 2).row(row % 2).array() += 1e-6;
  }
  const Acceptance found = AcceptLengths(all.test, all.made);
  ASSERT_EQ(found.lengths.size(), 6U);
  for (size_t i = 0; i < 6; ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    EXPECT_EQ(found.lengths[i].reference, &all.test.lengths[i / 2]);
    EXPECT_EQ(found.lengths[i].frame, i % 2 == 0 ? "f1" : "f2");
    EXPECT_NEAR(found.lengths[i].Deviation(), deviation[row], 1e-12);
    EXPECT_NEAR(found.lengths[i].sigma, std::sqrt(own[row]), 1e-8);
    EXPECT_EQ(found.lengths[i].limit, 0.01);
  }
  const Eigen::VectorXd weighted = covariance.inverse() * deviation;
  const double information = length.dot(covariance.inverse() * length);
  EXPECT_NEAR(found.chi_square / deviation.dot(weighted), 1, 1e-6);
  EXPECT_NEAR(found.scale, length.dot(weighted) / information, 1e-8);
  EXPECT_NEAR(found.scale_sigma * std::sqrt(information), 1, 1e-6);
  EXPECT_NEAR(found.probability, ChiSquareTail(6, found.chi_square), 1e-15);
  EXPECT_NEAR(found.largest, deviation.cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_NEAR(found.rms, deviation.norm() / std::sqrt(6), 1e-12);
  EXPECT_FALSE(found.passes);
}

// Bars 0-1 of 1 m and 2-3 of 2 m, whose measured lengths have the standard error sqrt(2) `sigma`.
Acceptance WithDeviations(double of_first, double of_second, double sigma) {
  static AcceptanceTest test;
  test = Simple({Bar(0, 1, 1), Bar(2, 3, 2)});
  return AcceptLengths(test, OnAxis({0, 1 + of_first, 5, 7 + of_second}, sigma));
}

TEST(AcceptLengths, NameACommonScaleWhereItIsSignificant) {
  // l' C^-1 l = (1 + 4) / (2 sigma^2), so a scale of t sqrt(2 / 5) sigma has t standard errors.
  constexpr double kSigma = 1e-4;
  for (const double sign : {1.0, -1.0}) {
    for (const double t : {3.2, 3.4}) {
      const double scale = sign * t * std::sqrt(0.4) * kSigma;
      const Acceptance found = WithDeviations(scale, 2 * scale, kSigma);
      EXPECT_NEAR(found.scale, scale, 1e-10);
      EXPECT_NEAR(found.chi_square, t * t, 1e-6);
      if (t < 3.3) {
        EXPECT_THAT(found.findings, IsEmpty());
        continue;
      }
      ASSERT_EQ(found.findings.size(), 1U);
      EXPECT_EQ(found.findings[0].code, "acceptance_scale");
      EXPECT_EQ(found.findings[0].grade, Grade::kUsable);
      EXPECT_NEAR(found.findings[0].value.value(), sign * t, 1e-6);
      EXPECT_EQ(
          found.findings[0].what,
          fmt::format("All lengths are 0.022 +- 0.006 % too {}.", sign > 0 ? "long" : "short"));
    }
  }
}

TEST(AcceptLengths, DeviationsThatNoScaleExplainsContradictTheStandardErrors) {
  const double sigma = 1e-4, of_length = std::sqrt(2) * sigma;
  // Deviations along (2, -1) are no scale; chi-square 13.7 and 13.9 of two: 1.06e-3 and 0.96e-3.
  for (const double chi_square : {13.7, 13.9}) {
    const double step = of_length * std::sqrt(chi_square / 5);
    const Acceptance found = WithDeviations(2 * step, -step, sigma);
    EXPECT_NEAR(found.chi_square, chi_square, 1e-6);
    EXPECT_NEAR(found.scale, 0, 1e-12);
    if (chi_square < 13.8) {
      EXPECT_THAT(found.findings, IsEmpty());
      continue;
    }
    ASSERT_EQ(found.findings.size(), 1U);
    EXPECT_EQ(found.findings[0].code, "acceptance_sigma");
    EXPECT_NEAR(found.findings[0].value.value(), chi_square / 2, 1e-6);
    EXPECT_EQ(found.findings[0].what,
              "The deviations are larger than the standard errors explain; the largest of them: p0 "
              "- p1 in f1, 3.3 sigma.");
  }
  // One length has no scale to share.
  const AcceptanceTest one = Simple({Bar(0, 1, 1)});
  const Acceptance found = AcceptLengths(one, OnAxis({0, 1 - 4 * of_length}, sigma));
  ASSERT_EQ(found.findings.size(), 1U);
  EXPECT_EQ(found.findings[0].code, "acceptance_sigma");
  EXPECT_NEAR(found.lengths[0].InSigmas(), -4, 1e-6);
}

TEST(AcceptLengths, ExactLengthsAreNotTested) {
  const Acceptance found = WithDeviations(0, 0.02, 0);
  EXPECT_EQ(found.chi_square, 0);
  EXPECT_EQ(found.probability, 1);
  EXPECT_EQ(found.scale_sigma, 0);
  EXPECT_THAT(found.findings, IsEmpty());
  EXPECT_FALSE(found.passes);
  EXPECT_TRUE(WithDeviations(0.005, -0.005, 0).passes);
}

TEST(AcceptLengths, OnlyUsedPointsBeforeTheCamerasCount) {
  const AcceptanceTest test = Simple({Bar(0, 1, 1), Bar(1, 2, 1), Bar(2, 3, 1), Bar(0, 9, 1)});
  Triangulation made = OnAxis({0, 1, 2, 3}, 1e-3);
  made.points[2].used = false;
  made.points[3].point.rho = 0;
  const Acceptance found = AcceptLengths(test, made);
  EXPECT_EQ(found.lengths.size(), 1U);
  EXPECT_THAT(found.left_out, ElementsAre("row: p1 - p2", "row: p2 - p3", "row: p0 - p9"));
  made.points[1].used = false;
  EXPECT_EQ(Refusal([&] { AcceptLengths(test, made); }),
            "job: no frame shows both ends of a length: row: p0 - p1; row: p1 - p2; row: p2 - p3; "
            "row: p0 - p9");
}

TEST(AcceptLengths, ABundleMakesOneSetOfPointsOfAllFrames) {
  AcceptanceTest test = Simple({Bar(0, 1, 1), Bar(2, 3, 2)});
  test.bundle = true;
  const std::vector<Eigen::Vector3d> points{{0, 0, 2}, {1, 0, 2}, {0, 1, 3}, {0, 3, 3}};
  Triangulation made;
  for (const auto& [frame, count] : {std::pair{"f1", 4}, {"f2", 4}, {"f3", 2}}) {
    const RigidTransform T{ExpRotation({0.1 * count, 0.2, 0}), {0.3, 0, 0.1}};
    for (int k = 0; k < count; ++k) {
      made.points.push_back({.frame = frame,
                             .marker = k,
                             .point = PointAt(T * points[static_cast<size_t>(k)], 1e-3),
                             .used = true});
    }
  }
  const Acceptance found = AcceptLengths(test, made);
  EXPECT_THAT(found.left_out, ElementsAre("f3: it has no three points in common with the others"));
  ASSERT_EQ(found.lengths.size(), 2U);
  for (const AcceptedLength& each : found.lengths) {
    EXPECT_EQ(each.frame, "all");
    EXPECT_NEAR(each.Deviation(), 0, 1e-9);
    // Two frames of as exact points.
    EXPECT_NEAR(each.sigma, 1e-3, 1e-4);
  }
}

// Five bars from one corner of the unit cube towards the opposite one, on each of seven lines: the
// diagonals, and three that start anywhere.
Simulated Complete() {
  Simulated all;
  const std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> lines{{{0, 0, 0}, {1, 1, 1}},
                                                                       {{1, 0, 0}, {0, 1, 1}},
                                                                       {{0, 1, 0}, {1, 0, 1}},
                                                                       {{0, 0, 1}, {1, 1, 0}},
                                                                       {{0.5, 0, 0}, {0.5, 1, 1}},
                                                                       {{0, 0.5, 0}, {1, 0.5, 1}},
                                                                       {{0, 0, 0.5}, {1, 1, 0.5}}};
  all.test = Simple({});
  for (size_t line = 0; line < lines.size(); ++line) {
    const auto& [from, to] = lines[line];
    for (int k = 0; k <= 5; ++k) {
      const int number = 10 * static_cast<int>(line) + k;
      const double part = k / 5.0;
      for (const char* frame : {"f1", "f2"}) {
        all.made.points.push_back({.frame = frame,
                                   .marker = number,
                                   .point = PointAt(from + part * (to - from), 1e-4),
                                   .used = true});
      }
      if (k == 0) continue;
      all.test.lengths.push_back(
          Bar(number - k, number, part * (to - from).norm(), fmt::format("d{}", line)));
    }
  }
  return all;
}

TEST(AcceptLengths, ACompleteTestHasSevenLinesOfFiveLengthsAndEndsInAllCorners) {
  const Simulated all = Complete();
  const Acceptance found = AcceptLengths(all.test, all.made);
  EXPECT_THAT(found.lacks, IsEmpty());
  EXPECT_EQ(found.lines, 7);
  EXPECT_EQ(found.lengths.size(), 70U);
  EXPECT_LT((found.volume - Eigen::Vector3d(1, 1, 1)).norm(), 1e-12);
  EXPECT_TRUE(found.passes);

  const auto lacks = [&](const auto& keep) {
    AcceptanceTest test = all.test;
    std::erase_if(test.lengths, [&](const ReferenceLength& bar) { return !keep(bar); });
    return AcceptLengths(test, all.made).lacks;
  };
  EXPECT_THAT(lacks([](const auto& bar) { return bar.line != "d6"; }),
              ElementsAre("6 measuring lines of 7"));
  EXPECT_THAT(lacks([](const auto& bar) { return bar.b.points[0] != 51; }),
              ElementsAre("4 lengths of 5 on d5"));
  // Without the far end of one diagonal its corner is open; the next end is a fifth away.
  EXPECT_THAT(lacks([](const auto& bar) { return bar.b.points[0] != 5; }),
              ElementsAre("4 lengths of 5 on d0"));
  EXPECT_THAT(lacks([](const auto& bar) { return bar.b.points[0] != 5 && bar.b.points[0] != 4; }),
              ElementsAre("3 lengths of 5 on d0", "an end in every corner of the volume"));
}

TEST(AcceptLengths, TheLongestLengthIsHeldAgainstTheVolume) {
  // Two parallel bars of length x in opposite corners of a box of 1 x 1 x 1 m.
  const auto lacks = [](double x) {
    AcceptanceTest test = Simple({Bar(0, 1, x), Bar(2, 3, x)});
    Triangulation made = OnAxis({0, x, 1 - x, 1}, 1e-4);
    for (const size_t k : {2U, 3U}) made.points[k].point.position += Eigen::Vector3d(0, 1, 1);
    return AcceptLengths(test, made).lacks;
  };
  const std::string side = "a length as long as the shortest side",
                    diagonal = "a length of 2/3 of the diagonal";
  EXPECT_THAT(lacks(0.99), Contains(side));
  EXPECT_THAT(lacks(1), ::testing::Not(Contains(side)));
  EXPECT_THAT(lacks(1), Contains(diagonal));
  EXPECT_THAT(lacks(0.9), Contains(diagonal));
  const double least = 2.0 / 3 * std::sqrt(3);
  for (const double part : {0.99, 1.01}) {
    AcceptanceTest test = Simple({Bar(0, 1, part * least)});
    Triangulation made = OnAxis({0, 1}, 1e-4);
    made.points[1].point.position += Eigen::Vector3d(0, 1, 1);
    const auto found = AcceptLengths(test, made).lacks;
    EXPECT_EQ(std::ranges::count(found, diagonal), part < 1 ? 1 : 0);
  }
}

// Two diagonals of a face and the two of the opposite one; one end lies `x`, `y`, `z` off its
// corner.
TEST(AcceptLengths, AnEndIsInACornerWithinAQuarterOfEachSide) {
  const auto lacks_corner = [](const Eigen::Vector3d& off) {
    const std::vector<Eigen::Vector3d> ends{
        {0, 0, 0}, {1, 1, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 1}, {1, 0, 1}, {0, 1, 1}};
    AcceptanceTest test = Simple({});
    Triangulation made = OnAxis(std::vector<double>(8), 1e-4);
    for (int k = 0; k < 8; ++k) {
      made.points[static_cast<size_t>(k)].point.position =
          ends[static_cast<size_t>(k)] + (k == 0 ? off : Eigen::Vector3d(0, 0, 0));
      if (k % 2 == 1) test.lengths.push_back(Bar(k - 1, k, 1));
    }
    const std::vector<std::string> lacks = AcceptLengths(test, made).lacks;
    return std::ranges::count(lacks, "an end in every corner of the volume") == 1;
  };
  EXPECT_FALSE(lacks_corner({0.25, 0.25, 0.25}));
  for (const Eigen::Vector3d& off :
       {Eigen::Vector3d(0.26, 0, 0), Eigen::Vector3d(0, 0.26, 0), Eigen::Vector3d(0, 0, 0.26)}) {
    EXPECT_TRUE(lacks_corner(off));
  }
}

struct Written {
  AcceptanceTest test = Simple({Bar(0, 1, 0.5, "a,b"), Bar(2, 3, 1)});
  Acceptance made;

  Written() {
    test.lengths[0].sigma = 3e-6;
    made.lengths = {{&test.lengths[0], "f1", 0.5002, 4e-6, 1e-4},
                    {&test.lengths[1], "f2", 0.9997, 1e-3, 1e-3}};
    made.lacks = {"x", "y"};
    made.largest = 3e-4;
    made.rms = 2.5e-4;
    made.lines = 2;
    made.volume = {1, 2, 3};
    made.chi_square = 7;
    made.probability = 0.25;
    made.scale = 1e-3;
    made.scale_sigma = 2e-3;
    made.left_out = {"row: p8 - p9"};
    made.findings = {{.code = "acceptance_scale", .what = "What.", .remedy = "Remedy."}};
  }
};

TEST(AcceptLengths, FilesHaveAllNumbers) {
  const Written written;
  const OutputContents files = AcceptanceFiles(written.made);
  ASSERT_EQ(files.size(), 2U);
  EXPECT_EQ(files[0].first, "acceptance.csv");
  EXPECT_EQ(
      files[0].second,
      "line,of,frame,reference,sigma_reference,measured,sigma,deviation,limit,passes,in_sigmas\n"
      "\"a,b\",p0 - p1,f1,0.5,3e-06,0.5002,4e-06,0.0002,0.0001,0,40\n"
      "row,p2 - p3,f2,1,0,0.9997,0.001,-0.0003,0.001,1,-0.3\n");
  EXPECT_EQ(files[1].first, "acceptance.json");
  const nlohmann::json json = nlohmann::json::parse(files[1].second);
  EXPECT_EQ(files[1].second.back(), '\n');
  nlohmann::json expected = nlohmann::json::parse(
      R"({"passes": false, "complete": false, "lacks": ["x", "y"], "lengths": 2, "lines": 2,
          "volume": [1.0, 2.0, 3.0], "largest": 3e-4, "rms": 2.5e-4, "chi_square": 7.0,
          "probability": 0.25, "scale": 1e-3, "scale_sigma": 2e-3, "left_out": ["row: p8 - p9"]})");
  expected["findings"] = json.at("findings");
  EXPECT_EQ(json, expected);
  EXPECT_EQ(json["findings"].at(0).at("code"), "acceptance_scale");
}

TEST(AcceptLengths, TheTextNamesTheLengthNearestToItsLimit) {
  Written written;
  EXPECT_EQ(AcceptanceText(written.made),
            "fail: 2 lengths, RMS deviation 0.25 mm, at most 0.3 mm; nearest to its limit: p0 - p1 "
            "in f1, +0.2 mm of 0.1 mm\n"
            "  no complete test after VDI/VDE 2634 part 1; it lacks: x; y\n"
            "  not measured: row: p8 - p9\n"
            "  acceptance_scale: What. Remedy.\n");
  written.made.passes = true;
  written.made.lengths[0].measured = 0.50001;
  written.made.lengths[1].measured = 0.99905;
  written.made.lacks.clear();
  written.made.left_out.clear();
  written.made.findings.clear();
  EXPECT_EQ(AcceptanceText(written.made),
            "pass: 2 lengths, RMS deviation 0.25 mm, at most 0.3 mm; nearest to its limit: p2 - p3 "
            "in f2, -0.95 mm of 1 mm\n");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
