// SPDX-License-Identifier: Apache-2.0
//
// Points of a parallel pair, whose positions and standard errors have formulas; which of them are
// left out, and the findings about the calibration.
#include "engine/rigs/triangulate_points.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <limits>

#include "calib/base/statistics.h"
#include "tests/calib/space/uncertain_rig.h"
#include "tests/engine/rigs/parallel_pair.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const std::vector<Eigen::Vector3d> kCorners{{0, 0, 2}, {0.3, 0, 2}, {0, 0.4, 2}, {0.1, 0.2, 2.5}};

ScenePosition Point(std::vector<int> numbers) {
  return {.name = std::to_string(numbers[0]), .points = std::move(numbers)};
}

Triangulation Made(const CalibrationRecord& record,
                   const std::vector<SeenPoints>& seen,
                   const TriangulateRequest& request = {}) {
  return TriangulatePoints(record, seen, request, {});
}

TEST(TriangulatePoints, NamesOfPointsAreNumbersTagsAndTheirCorners) {
  EXPECT_THAT(PositionNamed("12").points, ElementsAre(12));
  EXPECT_THAT(PositionNamed("0").points, ElementsAre(0));
  EXPECT_THAT(PositionNamed("tag 3").points, ElementsAre(12, 13, 14, 15));
  EXPECT_THAT(PositionNamed("tag 3 corner 2").points, ElementsAre(14));
  EXPECT_EQ(PositionNamed("tag 3 corner 2").name, "tag 3 corner 2");
  EXPECT_EQ(PositionNamed("12").name, "12");
  for (const std::string wrong : {"", "-1", "1.5", "12 ", "tug 3", "99999999999"}) {
    EXPECT_EQ(Refusal([&] { PositionNamed(wrong); }),
              "input: '" + wrong +
                  "' is no point: expected its number, 'tag ID' or 'tag ID corner 0' to 3");
  }
}

TEST(TriangulatePoints, PointsAndMeasuresOfAFrameHaveTheirValues) {
  CalibrationRecord record = ParallelCameras();
  record.path = "calibration.yaml";
  std::vector<SeenPoints> seen = SeenByPair(record, kCorners);
  // A second frame of one point, which the other camera sees before the first.
  for (size_t c = 0; c < 2; ++c) {
    seen[c].views.push_back(SeenByPair(record, {{0.1, 0.1, 1}}, "f2")[c].views[0]);
  }
  TriangulateRequest request;
  request.lengths = {{Point({0}), Point({1})}, {Point({1, 2}), Point({3})}};
  request.angles = {{Point({1}), Point({0}), Point({3})}};
  request.planes = {{Point({0}), Point({1}), Point({2}), Point({3})}};
  request.level = 0.9;
  const Triangulation made = Made(record, seen, request);
  EXPECT_THAT(made.cameras, ElementsAre("left", "right"));
  EXPECT_EQ(made.calibration, "calibration.yaml");
  EXPECT_EQ(made.level, 0.9);
  EXPECT_NEAR(made.sigmas, 1.6448536, 1e-6);
  ASSERT_EQ(made.points.size(), 5U);
  for (size_t k = 0; k < 4; ++k) {
    const TriangulatedPoint& each = made.points[k];
    EXPECT_EQ(each.frame, "f1");
    EXPECT_EQ(each.marker, static_cast<int>(k));
    EXPECT_TRUE(each.used);
    EXPECT_EQ(each.point.observations, 2);
    EXPECT_LT((each.point.position - kCorners[k]).norm(), 1e-6);
    const double z = kCorners[k].z();
    EXPECT_NEAR(std::sqrt(each.point.noise(2, 2)),
                z * z / (kPairFocal * kPairBase) * std::sqrt(2) * kPairNoise,
                2e-6);
  }
  EXPECT_EQ(made.points[4].Place(), "f2 point 0");
  ASSERT_EQ(made.measures.size(), 4U);
  const auto expect = [&](size_t i, const char* kind, const char* of, double value) {
    EXPECT_EQ(made.measures[i].frame, "f1");
    EXPECT_EQ(made.measures[i].kind, kind);
    EXPECT_EQ(made.measures[i].of, of);
    if (made.measures[i].number) {
      EXPECT_NEAR(made.measures[i].number->value, value, 1e-6);
    }
  };
  expect(0, "length", "0 1", 0.3);
  expect(1, "length", "1 3", Eigen::Vector3d(0.05, 0, -0.5).norm());
  expect(2, "angle", "1 0 3", std::acos(0.1 / Eigen::Vector3d(0.1, 0.2, 0.5).norm()));
  expect(3, "plane", "0 1 2 3", 0);
  EXPECT_EQ(made.measures[3].plane.value().degrees, 1);
  std::vector<std::string> left_out;
  for (const LeftOut& each : made.left_out) {
    left_out.push_back(each.where);
    EXPECT_EQ(each.reason, "a point of it is not there");
    EXPECT_EQ(each.frame, "f2");
  }
  EXPECT_THAT(left_out,
              ElementsAre("f2 length 0 1", "f2 length 1 3", "f2 angle 1 0 3", "f2 plane 0 1 2 3"));
  EXPECT_THAT(made.findings, IsEmpty());
  EXPECT_EQ(made.rays.degrees, 5);
}

TEST(TriangulatePoints, AllLengthsAreThoseOfAllPairsAfterTheOnesAskedFor) {
  const CalibrationRecord record = ParallelCameras();
  TriangulateRequest request;
  request.all_lengths = true;
  request.lengths = {{Point({2}), Point({0})}};
  std::vector<std::string> of;
  for (const TriangulatedMeasure& each :
       Made(record, SeenByPair(record, kCorners), request).measures) {
    of.push_back(each.of);
  }
  EXPECT_THAT(of, ElementsAre("2 0", "0 1", "0 2", "0 3", "1 2", "1 3", "2 3"));
}

TEST(TriangulatePoints, NoiseIsTheRequestsThenTheCalibrationsOrThePlacesOwn) {
  const CalibrationRecord record = ParallelCameras();
  std::vector<SeenPoints> seen = SeenByPair(record, {kCorners[0]});
  TriangulateRequest request;
  const auto sigma = [&] {
    return std::sqrt(Made(record, seen, request).points[0].point.noise(2, 2)) * 40 / std::sqrt(2);
  };
  EXPECT_NEAR(sigma(), kPairNoise, 1e-6);
  request.sigma = 0.3;
  EXPECT_NEAR(sigma(), 0.3, 1e-6);
  for (SeenPoints& each : seen) {
    each.is_noise = true;
    each.views[0].observations[0].detector_sigma = 0.2;
  }
  EXPECT_NEAR(sigma(), 0.2, 1e-6);
  // Noise that both images share does not change the difference of places.
  request.correlation = 0.75;
  EXPECT_NEAR(sigma(), 0.1, 1e-6);
}

TEST(TriangulatePoints, DisplacementsThatTablesStateMoveAllPointsTogether) {
  const CalibrationRecord record = ParallelCameras();
  std::vector<SeenPoints> seen = SeenByPair(record, {kCorners[0], kCorners[1]});
  seen[0].views[0].by_nuisance = {{0.5, 0}, {0.5, 0}};
  const Triangulation made = Made(record, seen);
  const SpacePoint &a = made.points[0].point, &b = made.points[1].point;
  // Half a pixel of 40 / m disparity at 2 m, in both points the same.
  EXPECT_NEAR(a.ByCalibration().row(2).norm(), 0.5 / 40, 1e-5);
  EXPECT_NEAR((a.shared - b.shared).row(2).norm(), 0, 1e-5);
}

// Each point's places differ by `miss` standard deviations in y, where a pair's rays must agree.
std::vector<SeenPoints> Missing(const CalibrationRecord& record, const std::vector<double>& miss) {
  std::vector<Eigen::Vector3d> points;
  for (size_t k = 0; k < miss.size(); ++k) {
    points.emplace_back(0.05 * static_cast<double>(k) - 0.2, 0.02 * static_cast<double>(k), 2);
  }
  std::vector<SeenPoints> seen = SeenByPair(record, points);
  for (size_t k = 0; k < miss.size(); ++k) {
    seen[1].views[0].observations[k].values[1] += miss[k] * std::sqrt(2) * kPairNoise;
  }
  return seen;
}

TEST(TriangulatePoints, RaysThatMissEachOtherAreLeftOutAtOneIn20Recordings) {
  const CalibrationRecord record = ParallelCameras();
  for (const double miss : {2.80, 2.82}) {  // of ten points: 2.807
    const Triangulation made = Made(record, Missing(record, {miss, 0, 0, 0, 0, 0, 0, 0, 0, 0}));
    EXPECT_EQ(made.points[0].used, miss < 2.81);
    EXPECT_NEAR(made.points[0].point.chi_square, miss * miss, 1e-3);
    EXPECT_TRUE(made.points[1].used);
    EXPECT_EQ(made.rays.degrees, miss < 2.81 ? 10 : 9);
    if (miss < 2.81) {
      EXPECT_THAT(made.left_out, IsEmpty());
      continue;
    }
    ASSERT_EQ(made.left_out.size(), 1U);
    EXPECT_EQ(made.left_out[0].where, "f1 point 0");
    EXPECT_EQ(made.left_out[0].frame, "f1");
    EXPECT_EQ(made.left_out[0].reason,
              "its rays miss each other by 0.2 px RMS (probability 0.005)");
  }
}

TEST(TriangulatePoints, WhereMostRaysMissThePointsStay) {
  const CalibrationRecord record = ParallelCameras();
  const Triangulation half = Made(record, Missing(record, {6, 6, 0, 0}));
  EXPECT_EQ(half.left_out.size(), 2U);
  EXPECT_THAT(half.findings, IsEmpty());
  const Triangulation most = Made(record, Missing(record, {6, 6, 6, 0}));
  EXPECT_THAT(most.left_out, IsEmpty());
  ASSERT_EQ(most.findings.size(), 1U);
  EXPECT_EQ(most.findings[0].code, "rays_contradict_calibration");
  EXPECT_EQ(most.findings[0].grade, Grade::kBad);
  EXPECT_THAT(most.findings[0].cameras, ElementsAre("left", "right"));
  EXPECT_NEAR(most.findings[0].value.value(), 27, 0.01);
  EXPECT_EQ(
      most.findings[0].what,
      "The rays of all points together miss each other by more than noise and the calibration "
      "explain (chi-square 108 of 4 degrees of freedom).");
}

TEST(TriangulatePoints, AllRaysTogetherContradictAtOneInAThousand) {
  const CalibrationRecord record = ParallelCameras();
  for (const double miss : {3.27, 3.31}) {  // one degree: 3.291
    const Triangulation made = Made(record, Missing(record, {miss}));
    EXPECT_TRUE(made.points[0].used);
    EXPECT_EQ(made.findings.size(), miss < 3.29 ? 0U : 1U);
    EXPECT_NEAR(made.rays.chi_square, miss * miss, 1e-3);
    EXPECT_NEAR(made.rays.probability, ChiSquareTail(1, made.rays.chi_square), 1e-12);
  }
}

TEST(TriangulatePoints, PointsThatAreFarFromAllRaysAreThoseOfOtherCameras) {
  const CalibrationRecord record = ParallelCameras();
  EXPECT_EQ(Refusal([&] { Made(record, Missing(record, {49, 49, 49})); }), "");
  EXPECT_EQ(Refusal([&] {
              Made(record, Missing(record, {60, 60, 0}));
            }),
            "input: left=left.csv, right=right.csv: rays of one point miss each other by 60 times "
            "their noise in half of the points; check that they belong to these cameras, and have "
            "the same numbers for the same points");
  EXPECT_THAT(Refusal([&] {
                Made(record, Missing(record, {51, 51, 51}));
              }),
              HasSubstr(" 51 times"));
  EXPECT_EQ(Refusal([&] { Made(record, Missing(record, {60, 0, 0})); }), "");
}

TEST(TriangulatePoints, WithoutTwoRaysThereIsNoPoint) {
  const CalibrationRecord record = ParallelCameras();
  std::vector<SeenPoints> seen = SeenByPair(record, {kCorners[0]});
  seen[1].views[0].observations[0].marker = 7;
  const std::string refusal = Refusal([&] { Made(record, seen); });
  EXPECT_THAT(refusal, ::testing::StartsWith("job: no point is seen by two rays that meet; "));
  for (SeenPoints& each : seen) each.views.clear();
  EXPECT_EQ(Refusal([&] { Made(record, seen); }), "job: no point is seen by two rays that meet");
}

TEST(TriangulatePoints, RequestsThatDoNotFitAreRefused) {
  const CalibrationRecord record = ParallelCameras(), three = ParallelCameras(1e-9, 3);
  const std::vector<SeenPoints> seen = SeenByPair(record, kCorners);
  const auto refused = [&](const auto& change) {
    TriangulateRequest request;
    change(&request);
    return Refusal([&] { Made(record, seen, request); });
  };
  const auto correlated = [](double value) {
    return [=](TriangulateRequest* request) { request->correlation = value; };
  };
  EXPECT_EQ(refused([](auto* request) {
              request->lengths = {{Point({0}), Point({0})}};
            }),
            "input: --length 0,0: expected 2 different points");
  EXPECT_EQ(refused([](auto* request) {
              request->lengths = {{Point({0}), Point({1}), Point({2})}};
            }),
            "input: --length 0,1,2: expected 2 different points");
  EXPECT_EQ(refused([](auto* request) {
              request->angles = {{Point({0}), Point({1})}};
            }),
            "input: --angle 0,1: expected 3 different points");
  EXPECT_EQ(refused([](auto* request) {
              request->planes = {{Point({0}), Point({1})}};
            }),
            "input: --plane 0,1: expected 3 or more different points");
  EXPECT_EQ(refused(correlated(1)),
            "input: --correlation 1: that of 2 cameras lies between -1 and 1");
  EXPECT_EQ(refused(correlated(-1)),
            "input: --correlation -1: that of 2 cameras lies between -1 and 1");
  EXPECT_EQ(refused(correlated(-0.9)), "");
  EXPECT_EQ(refused(correlated(0.99)), "");
  TriangulateRequest of_three;
  of_three.correlation = -0.5;
  EXPECT_EQ(Refusal([&] { Made(three, SeenByPair(three, kCorners), of_three); }),
            "input: --correlation -0.5: that of 3 cameras lies between -0.5 and 1");
  EXPECT_EQ(refused([](auto* request) { request->frame = SpaceFrame::kHousing; }),
            "input: --frame housing needs the calibration's own points: give the folder that "
            "'plenocal calibrate' wrote, in place of the calibration");
  EXPECT_EQ(Refusal([&] { Made(record, {}); }), "input: give the points of one camera or more");
  EXPECT_EQ(
      Refusal([&] { Made(record, {seen[0]}); }),
      "input: left.csv: one ordinary camera sees directions, no points; give those of another "
      "camera, too");
  EXPECT_EQ(Refusal([&] {
              Made(record, {seen[0], seen[0]});
            }),
            "input: left.csv: camera 'left' has points already");
}

TEST(TriangulatePoints, NoiseOfPlenopticCamerasIsNotCorrelated) {
  const CalibrationRecord record = UncertainRig({.models = {"pinhole", "focused-plenoptic"}});
  TriangulateRequest request;
  request.correlation = 0.1;
  EXPECT_EQ(Refusal([&] {
              Made(record,
                   {{.camera = "camera0", .source = "a", .views = {}},
                    {.camera = "camera1", .source = "b", .views = {}}},
                   request);
            }),
            "input: --correlation is that of ordinary cameras; 'camera1' is plenoptic");
}

TEST(TriangulatePoints, WarnAndFindWhatTheCalibrationLeavesOpen) {
  std::vector<std::string> warnings;
  plenocal::Run run;
  run.listener.warning = [&](const std::string& line) { warnings.push_back(line); };
  CalibrationRecord record = ParallelCameras(0);
  const std::vector<SeenPoints> seen = SeenByPair(record, kCorners);
  TriangulatePoints(record, seen, {}, run);
  EXPECT_THAT(
      warnings,
      ElementsAre("the calibration: no standard errors; those of points contain the noise of "
                  "the images alone"));
  TriangulateRequest adjust;
  adjust.adjust = true;
  EXPECT_EQ(Refusal([&] { TriangulatePoints(record, seen, adjust, run); }),
            "input: the calibration: has no standard errors, within which --adjust moves it");
  for (CalibratedCamera& camera : record.cameras) camera.fit.noise_sigma = 0;
  EXPECT_EQ(Refusal([&] { TriangulatePoints(record, seen, {}, run); }),
            "input: camera 'left' has no noise in the calibration: state it with --sigma");

  warnings.clear();
  record = ParallelCameras(1e-6);
  record.path = "c.yaml";
  record.cameras[1].covariance(0, 0) = std::numeric_limits<double>::infinity();
  const Triangulation made = TriangulatePoints(record, seen, {}, run);
  EXPECT_THAT(
      warnings,
      ElementsAre("c.yaml: no correlations.csv beside it, without which the cameras' errors "
                  "count as independent: standard errors of points can be far too large"));
  ASSERT_EQ(made.findings.size(), 1U);
  EXPECT_EQ(made.findings[0].code, "undetermined");
  EXPECT_EQ(made.findings[0].grade, Grade::kBad);
  EXPECT_EQ(made.findings[0].what,
            "The calibration does not determine right.f_x: standard errors of points hold for the "
            "values that it has.");
}

// A right camera that has turned about its x axis moves all of its places up or down.
TEST(TriangulatePoints, TheCalibrationFollowsTheRays) {
  constexpr double kSigma = 1e-3, kTurn = 7e-4;  // rad
  CalibrationRecord record = ParallelCameras(1e-7);
  record.cameras[1].sigma_xi[3] = kSigma;
  CalibrationRecord truth = record;
  truth.cameras[1].T_camera_rig.R = ExpRotation({kTurn, 0, 0});
  TriangulateRequest request;
  const std::vector<SeenPoints> seen = SeenByPair(truth, kCorners);
  const Triangulation before = Made(record, seen);
  request.adjust = true;
  const Triangulation made = Made(record, seen, request);
  EXPECT_THAT(before.adjusted, IsEmpty());
  const auto turn =
      std::ranges::find(made.adjusted, "right.T_camera_rig.w_x", &AdjustedNumber::name);
  ASSERT_NE(turn, made.adjusted.end());
  EXPECT_NEAR(turn->change, kTurn, 0.02 * kTurn);
  EXPECT_NEAR(turn->sigma_before, kSigma, 1e-2 * kSigma);
  // Four differences of places, each with sqrt(2) of noise.
  EXPECT_NEAR(turn->sigma, std::sqrt(2) * kPairNoise / kPairFocal / 2, 0.1 * turn->sigma);
  for (size_t k = 0; k < kCorners.size(); ++k) {
    EXPECT_LT((made.points[k].point.position - kCorners[k]).norm(), 1e-4);
    EXPECT_GT((before.points[k].point.position - kCorners[k]).norm(), 1e-4);
    EXPECT_EQ(made.points[k].point.chi_square, before.points[k].point.chi_square);
    EXPECT_EQ(made.points[k].point.probability, before.points[k].point.probability);
  }
}

TEST(TriangulatePoints, TheJitterOfAFrameTurnsAboutTheMiddleOfItsPoints) {
  CalibrationRecord record = ParallelCameras();
  const auto by_frame = [&](const std::vector<Eigen::Vector3d>& points, double rotation) {
    record.jitter = JitterRecord{.translation_sigma = 1e-3, .rotation_sigma = rotation};
    return Made(record, SeenByPair(record, points)).points[0].point.ByFrame().norm();
  };
  const Eigen::Vector3d a(0.2, 0.1, 2), b(-0.4, 0.3, 3);
  EXPECT_GT(by_frame({a}, 0), 1e-3);
  EXPECT_NEAR(by_frame({a}, 0.1), by_frame({a}, 0), 1e-6);
  EXPECT_GT(by_frame({a, b}, 0.1), 2 * by_frame({a, b}, 0));
  TriangulateRequest request;
  request.adjust = true;
  EXPECT_EQ(Refusal([&] { Made(record, SeenByPair(record, {a}), request); }),
            "input: the calibration: the rig is not rigid, or its cameras are not synchronous "
            "(jitter): --adjust would take the motion of single frames for an error of the "
            "calibration");
}

TEST(TriangulatePoints, PointsAtInfinityHaveNoMeasures) {
  const CalibrationRecord record = ParallelCameras();
  std::vector<SeenPoints> seen = SeenByPair(record, {kCorners[0], kCorners[1]});
  for (SeenPoints& each : seen) each.views[0].observations[1].values[0] = 400;
  TriangulateRequest request;
  request.all_lengths = true;
  const Triangulation made = Made(record, seen, request);
  EXPECT_TRUE(made.points[1].used);
  EXPECT_NEAR(made.points[1].point.rho, 0, 1e-6);
  EXPECT_EQ(made.measures.size(), made.points[1].point.rho > 0 ? 1U : 0U);
}

TEST(TriangulatePoints, ResultsGoIntoTheFolder) {
  const TemporaryFolder folder;
  const CalibrationRecord record = ParallelCameras();
  TriangulateRequest request;
  request.out = folder / "out";
  request.all_lengths = true;
  const Triangulation made = Made(record, SeenByPair(record, kCorners), request);
  EXPECT_EQ(made.measures.size(), 6U);
  for (const char* name : {"points.csv", "shared.csv", "measures.csv", "triangulation.yaml"}) {
    EXPECT_FALSE(folder.Read(std::string("out/") + name).empty()) << name;
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
