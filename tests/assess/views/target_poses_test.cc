// SPDX-License-Identifier: Apache-2.0
#include "assess/views/target_poses.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "assess/views/next_views.h"
#include "calib/base/error.h"
#include "models/registry.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr double kPi = std::numbers::pi;

// A camera of 400 x 300 px before a board of 0.4 x 0.2 m whose printed side looks along -z.
RigEstimate OneCamera() {
  RigEstimate rig;
  rig.bundle.cameras.push_back({.name = "left",
                                .image_size = {400, 300},
                                .model = FindModel(CameraModels(), "pinhole"),
                                .config = {},
                                .params = {500, 500, 200, 150},
                                .fixed = std::vector<bool>(4, false),
                                .T_camera_rig = {},
                                .is_master = true});
  return rig;
}

ViewTarget Board() {
  ViewTarget target{
      .markers = {{0, {0, 0, 0}}, {1, {0.4, 0, 0}}, {2, {0.4, 0.2, 0}}, {3, {0, 0.2, 0}}}};
  for (int i = 0; i < 4; ++i) target.normals[i] = {0, 0, -1};
  return target;
}

TEST(FeasibleRange, BeginsWhereTheTargetFillsTheImage) {
  const RigEstimate rig = OneCamera();
  ViewTarget board = Board();
  EXPECT_EQ(MiddleOf(board), Eigen::Vector3d(0.2, 0.1, 0));
  // 500 px of diagonal of 1/500 rad (over ten of them) before an extent of sqrt(0.2) m.
  const double pixel = std::atan(10 / 500.0) / 10;
  const double nearest = std::sqrt(0.2) / 2 / std::tan(500 * pixel / 2);
  ViewRange range = FeasibleRange(rig, 0, board, {}, {});
  EXPECT_NEAR(range.nearest, nearest, 1e-9);
  EXPECT_NEAR(range.farthest, 10 * nearest, 1e-8);
  board.finest = 0.02;
  range = FeasibleRange(rig, 0, board, {}, {});
  EXPECT_NEAR(range.farthest, 0.02 / (3 * pixel) / std::sqrt(2), 1e-9);
  // Twice beyond what was seen.
  range = FeasibleRange(rig, 0, board, {1.0, 1.1}, {});
  EXPECT_NEAR(range.nearest, 0.5, 1e-9);
  EXPECT_NEAR(range.farthest, 2.2, 1e-9);
  range = FeasibleRange(rig, 0, board, {0.1, 5}, {});
  EXPECT_NEAR(range.nearest, nearest, 1e-9);
  EXPECT_NEAR(range.farthest, 0.02 / (3 * pixel) / std::sqrt(2), 1e-9);
  // A detail that is not even resolved there.
  board.finest = 1e-4;
  range = FeasibleRange(rig, 0, board, {}, {});
  EXPECT_EQ(range.farthest, range.nearest);
  range = FeasibleRange(rig, 0, board, {}, {0.3, 0.9});
  EXPECT_EQ(range.nearest, 0.3);
  EXPECT_EQ(range.farthest, 0.9);
  EXPECT_EQ(RefusalOf([&] {
              FeasibleRange(rig, 0, board, {}, {2, 1.5});
            }),
            "left: no distance for the target between 2 m and 1.5 m; set --near and --far");
}

TEST(FeasibleRange, IsLimitedByTheHandBeforeAWideLens) {
  RigEstimate rig = OneCamera();
  rig.bundle.cameras[0].params = {100, 100, 200, 150};  // 5 rad by the middle pixel
  EXPECT_NEAR(
      FeasibleRange(rig, 0, Board(), {}, {}).nearest, std::sqrt(0.2) / 2 / std::tan(1), 1e-9);
}

TEST(FeasibleRange, OfAPlenopticCameraIsAboutWhatWasSeen) {
  RigEstimate rig = OneCamera();
  CameraModel plenoptic = *rig.bundle.cameras[0].model;
  plenoptic.plenoptic = true;
  rig.bundle.cameras[0].model = &plenoptic;
  const ViewRange range = FeasibleRange(rig, 0, Board(), {0.6, 0.8, 0.9}, {});
  EXPECT_NEAR(range.nearest, 0.3, 1e-12);
  EXPECT_NEAR(range.farthest, 1.8, 1e-12);
  EXPECT_THROW(FeasibleRange(rig, 0, Board(), {}, {}), Error);
}

TEST(FeasibleRange, NeedsRaysInTheMiddleOfTheImage) {
  RigEstimate rig = OneCamera();
  CameraModel narrow = *rig.bundle.cameras[0].model;
  rig.bundle.cameras[0].model = &narrow;
  narrow.functions.unproject =
      [](const CameraModel&, const double* params, const double*, const double* values) {
        return values[0] > params[0] ? std::nullopt : std::optional<Ray>({{0, 0, 0}, {0, 0, 1}});
      };
  for (const double limit : {195, 205}) {  // of x; the middle is at 200
    rig.bundle.cameras[0].params[0] = limit;
    EXPECT_THROW(FeasibleRange(rig, 0, Board(), {}, {}), Error);
  }
}

TEST(CandidatePoses, AreAGridOverImageDistanceAndTilt) {
  const RigEstimate rig = OneCamera();
  ViewTarget board = Board();
  const ViewRange range{2, 8};
  const std::vector<TargetPose> poses = CandidatePoses(rig, 0, board, range, 0.8);
  ASSERT_EQ(poses.size(), 7U * 5 * 6 * (1 + 3 * 8) * 2);
  std::map<double, size_t> x, y, distances, tilts, turns, directions;
  for (const TargetPose& pose : poses) {
    ++x[pose.place.x()], ++y[pose.place.y()], ++distances[1 / pose.distance];
    ++tilts[pose.tilt], ++turns[pose.turn];
    if (pose.tilt > 0) ++directions[pose.away];
  }
  const auto expect = [](const std::map<double, size_t>& found, std::vector<double> values) {
    ASSERT_EQ(found.size(), values.size());
    size_t i = 0;
    for (const auto& [value, count] : found) {
      EXPECT_NEAR(value, values[i++], 1e-9);
      if (found.size() != 4) {
        EXPECT_EQ(count, found.begin()->second);
      }
    }
  };
  expect(x, {48, 48 + 304 / 6.0, 48 + 304 / 3.0, 200, 352 - 304 / 3.0, 352 - 304 / 6.0, 352});
  expect(y, {36, 93, 150, 207, 264});
  expect(distances, {0.125, 0.2, 0.275, 0.35, 0.425, 0.5});
  expect(tilts, {0, 0.32, 0.56, 0.8});
  expect(turns, {0, kPi / 2});
  expect(directions,
         {0, kPi / 4, kPi / 2, 3 * kPi / 4, kPi, 5 * kPi / 4, 3 * kPi / 2, 7 * kPi / 4});
  board.found_in_part = true;
  EXPECT_NEAR(CandidatePoses(rig, 0, board, range, 0.8).front().place.x(), 8, 1e-9);
  EXPECT_NEAR(CandidatePoses(rig, 0, board, range, 0.8).back().place.y(), 294, 1e-9);
}

TEST(NeighbourPose, ChangesOneNumberUpOrDown) {
  const TargetPose pose{
      .camera = 1, .place = {90, 50}, .distance = 2, .tilt = 0.4, .away = 1, .turn = 0.2};
  constexpr double kStep = 0.5;
  for (size_t k = 0; k < kNeighbours; ++k) {
    const auto numbers = [](const TargetPose& each) {
      return std::array{
          each.place.x(), each.place.y(), each.distance, each.tilt, each.away, each.turn};
    };
    const std::array steps{400 / 12.0, 300 / 12.0, 0.12 * 2, 0.15, 0.4, 0.4};
    std::array expected = numbers(pose);
    expected[k / 2] += (k % 2 == 0 ? kStep : -kStep) * steps[k / 2];
    const TargetPose next = NeighbourPose(pose, k, kStep, {400, 300}, {1, 4}, 0.8);
    EXPECT_THAT(numbers(next), ::testing::Pointwise(::testing::DoubleNear(1e-12), expected)) << k;
    EXPECT_EQ(next.camera, 1U);
  }
  const auto limited = [&](size_t k) {
    return NeighbourPose(pose, k, kStep, {400, 300}, {1.95, 2.05}, 0.41);
  };
  EXPECT_EQ(limited(4).distance, 2.05);
  EXPECT_EQ(limited(5).distance, 1.95);
  EXPECT_EQ(limited(6).tilt, 0.41);
  EXPECT_EQ(NeighbourPose({.tilt = 0.01}, 7, kStep, {400, 300}, {1, 4}, 0.8).tilt, 0);
}

// Along each number a parabola, whose top the steps reach within an eighth of the first one.
TEST(LargestNearby, ClimbsByHalvedSteps) {
  const auto numbers = [](const TargetPose& each) {
    return std::array{
        each.place.x(), each.place.y(), each.distance, each.tilt, each.away, each.turn};
  };
  const auto neighbour = [](TargetPose pose, size_t k, double step) {
    const std::array each{
        &pose.place.x(), &pose.place.y(), &pose.distance, &pose.tilt, &pose.away, &pose.turn};
    *each[k / 2] += k % 2 == 0 ? step : -step;
    return pose;
  };
  const std::array top{1.7, -1.3, 0.8, -0.6, 0.2, -1.9};
  int tried = 0;
  const auto value = [&](const TargetPose& pose) {
    ++tried;
    double sum = 0;
    for (size_t k = 0; k < 6; ++k) sum -= std::pow(numbers(pose)[k] - top[k], 2);
    return sum;
  };
  const TargetPose found = LargestNearby({}, neighbour, value);
  EXPECT_THAT(numbers(found), ::testing::ElementsAre(1.75, -1.25, 0.75, -0.5, 0.25, -1.75));
  EXPECT_EQ(tried, 1 + 3 * 12);
  const auto none = [](const TargetPose&) { return -std::numeric_limits<double>::infinity(); };
  EXPECT_THAT(numbers(LargestNearby(found, neighbour, none)),
              ::testing::ElementsAreArray(numbers(found)));
}

TEST(PlaceTarget, PutsTheMiddleAtItsPlaceTiltedAndTurned) {
  const RigEstimate rig = OneCamera();
  const ViewTarget board = Board();
  TargetPose pose{.place = {300, 100}, .distance = 2};
  RigidTransform T = *PlaceTarget(rig, board, pose);
  const Eigen::Vector3d sight = Eigen::Vector3d(0.2, -0.1, 1).normalized();
  EXPECT_LT((T * MiddleOf(board) - 2 * sight).norm(), 1e-12);
  // It faces the camera along the line of sight, upright.
  EXPECT_LT((T.R * Eigen::Vector3d(0, 0, -1) + sight).norm(), 1e-12);
  EXPECT_GT(T.R(0, 0), 0.95);
  pose = {.place = {200, 150}, .distance = 2};
  T = *PlaceTarget(rig, board, pose);
  EXPECT_LT((T.R - Eigen::Matrix3d::Identity()).norm(), 1e-12);
  for (int i = 0; i < 8; ++i) {
    pose.tilt = 0.5;
    pose.away = i * kPi / 4;
    T = *PlaceTarget(rig, board, pose);
    const Eigen::Vector3d side(std::cos(pose.away), std::sin(pose.away), 0);
    // A point on that side of the middle is farther by the sine of the tilt.
    EXPECT_NEAR((T * (MiddleOf(board) + side) - T * MiddleOf(board)).z(), std::sin(0.5), 1e-12);
    EXPECT_NEAR(std::acos(T.R(2, 2)), 0.5, 1e-9);
  }
  pose = {.place = {200, 150}, .distance = 2, .turn = kPi / 2};
  T = *PlaceTarget(rig, board, pose);
  EXPECT_LT((T.R.col(0) - Eigen::Vector3d::UnitY()).norm(), 1e-12);
  EXPECT_LT((T.R.col(1) + Eigen::Vector3d::UnitX()).norm(), 1e-12);
}

TEST(PlaceTarget, ShowsThePrintedSideOfAnyTarget) {
  const RigEstimate rig = OneCamera();
  for (const Eigen::Vector3d& normal : {Eigen::Vector3d(0, 0, 1),
                                        Eigen::Vector3d(1, 0, 0),
                                        Eigen::Vector3d(0.6, 0, -0.8),
                                        Eigen::Vector3d(0.999, 0.0447, 0)}) {
    ViewTarget target = Board();
    for (auto& [number, each] : target.normals) each = normal.normalized();
    const RigidTransform T = *PlaceTarget(rig, target, {.place = {200, 150}, .distance = 1});
    EXPECT_LT((T.R * normal.normalized() + Eigen::Vector3d::UnitZ()).norm(), 1e-9);
    EXPECT_NEAR(T.R.determinant(), 1, 1e-9);
    // Upright: x to the right, or y where x looks at the camera.
    const bool along_x = std::abs(normal.x()) > 0.99;
    EXPECT_GT(T.R(0, along_x ? 1 : 0), 0.5);
    EXPECT_NEAR(T.R(1, along_x ? 1 : 0), 0, 1e-9);
  }
  ViewTarget none = Board();
  none.normals.clear();
  EXPECT_LT((PlaceTarget(rig, none, {.place = {200, 150}, .distance = 1})->R -
             Eigen::Matrix3d::Identity())
                .norm(),
            1e-12);
}

TEST(ExecutedPoses, ErrInEachDirectionAboutTheMiddle) {
  const ViewTarget board = Board();
  const RigidTransform T{ExpRotation({0.1, 0.2, 0.3}), {0.1, -0.2, 1}};
  const std::vector<RigidTransform> poses = ExecutedPoses(T, board, 0.05, 0.1);
  ASSERT_EQ(poses.size(), 7U);
  const Eigen::Vector3d middle = T * MiddleOf(board);
  const std::array<Eigen::Vector3d, 7> turns{
      {{0, 0, 0}, {1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}}};
  for (size_t i = 0; i < 7; ++i) {
    EXPECT_LT((LogRotation(poses[i].R * T.R.transpose()) - 0.05 * turns[i]).norm(), 1e-12);
    const double factor = i < 5 ? 1 : i == 5 ? 1.1 : 0.9;
    EXPECT_LT((poses[i] * MiddleOf(board) - factor * middle).norm(), 1e-12);
  }
}

TEST(LookDifferent, ByEachNumberAlone) {
  constexpr double kDegree = std::numbers::pi / 180;
  const ImageSize size{900, 600};
  const TargetPose pose{.camera = 1,
                        .place = {400, -350},
                        .distance = 2,
                        .tilt = 30 * kDegree,
                        .away = 100 * kDegree,
                        .turn = 0.5};
  const auto differs = [&](const auto& change) {
    TargetPose other = pose;
    change(other);
    const bool does = LookDifferent(pose, other, size);
    EXPECT_EQ(LookDifferent(other, pose, size), does);
    return does;
  };
  EXPECT_FALSE(differs([](TargetPose&) {}));
  EXPECT_TRUE(differs([](TargetPose& other) { other.camera = 0; }));
  EXPECT_TRUE(differs([](TargetPose& other) { other.turn = 0.25; }));
  for (const double sign : {-1.0, 1.0}) {
    EXPECT_FALSE(differs([&](TargetPose& other) { other.place.x() += sign * 299; }));
    EXPECT_TRUE(differs([&](TargetPose& other) { other.place.x() += sign * 301; }));
    EXPECT_FALSE(differs([&](TargetPose& other) { other.place.y() += sign * 199; }));
    EXPECT_TRUE(differs([&](TargetPose& other) { other.place.y() += sign * 201; }));
    EXPECT_FALSE(differs([&](TargetPose& other) { other.tilt += sign * 19.9 * kDegree; }));
    EXPECT_TRUE(differs([&](TargetPose& other) { other.tilt += sign * 20.1 * kDegree; }));
    // The normals of two tilts of 30 degrees are 20 apart with 40.6 between their sides:
    // sin(10) = sin(30) sin(20.3).
    EXPECT_FALSE(differs([&](TargetPose& other) { other.away += sign * 40 * kDegree; }));
    EXPECT_TRUE(differs([&](TargetPose& other) { other.away += sign * 41.5 * kDegree; }));
  }
  EXPECT_FALSE(differs([](TargetPose& other) { other.distance = 2.49; }));
  EXPECT_TRUE(differs([](TargetPose& other) { other.distance = 2.51; }));
  EXPECT_FALSE(differs([](TargetPose& other) { other.distance = 1.61; }));
  EXPECT_TRUE(differs([](TargetPose& other) { other.distance = 1.59; }));
}

NextView ViewOf(double tilt, double away, double turn, double distance) {
  NextView view{
      .pose = {.place = {380, 20}, .distance = distance, .tilt = tilt, .away = away, .turn = turn},
      .sigma_before = 0.5,
      .sigma_after = 0.25};
  view.cameras = {0};
  return view;
}

TEST(NextViewText, SaysWhereTheTargetIs) {
  RigEstimate rig = OneCamera();
  EXPECT_EQ(
      NextViewText(ViewOf(0, 0, 0, 0.956), rig, {}),
      "target in the upper right corner, 96 cm away, facing the camera: sigma 0.5 -> 0.25 px");
  const char* const sides[] = {"right side",
                               "lower right corner",
                               "lower edge",
                               "lower left corner",
                               "left side",
                               "upper left corner",
                               "upper edge",
                               "upper right corner"};
  for (int i = -20; i < 20; ++i) {
    EXPECT_EQ(NextViewText(ViewOf(0.5, i * kPi / 4, 1, 1.26), rig, {.unit = "mm"}),
              std::string("target in the upper right corner, 1.3 m away, its ") +
                  sides[(i + 24) % 8] +
                  " tilted away by 29 degrees, turned by 90 degrees: sigma 0.5 -> 0.25 mm");
  }
  rig.bundle.cameras.push_back(rig.bundle.cameras[0]);
  rig.bundle.cameras[1].name = "right";
  NextView view = ViewOf(0, 0, 0, 1);
  view.cameras = {0, 1};
  view.region = 7;
  view.region_before = 0.8, view.region_after = 0.3;
  EXPECT_EQ(
      NextViewText(view, rig, {}),
      "target in the upper right corner of left, 1.0 m away, facing the camera, seen by left, "
      "right: sigma in the lower part 0.8 -> 0.3 px");
  view.criterion = ViewCriterion::kEntropy;
  EXPECT_EQ(
      NextViewText(view, rig, {}),
      "target in the upper right corner of left, 1.0 m away, facing the camera, seen by left, "
      "right: determines what the images so far leave open");
  const char* const regions[] = {"upper left corner",
                                 "upper part",
                                 "upper right corner",
                                 "left part",
                                 "middle",
                                 "right part",
                                 "lower left corner",
                                 "lower part",
                                 "lower right corner"};
  for (size_t r = 0; r < kRegions; ++r) EXPECT_EQ(RegionName(r), regions[r]);
}

TEST(NextViewsText, StatesSigmaGoalBoundAndVerdict) {
  const RigEstimate rig = OneCamera();
  NextViews next;
  next.sigma = 0.5, next.goal = 0.1, next.frames = 8;
  next.views = {ViewOf(0, 0, 0, 0.5)};
  const std::string view =
      "  1. target in the upper right corner, 50 cm away, facing the camera: sigma 0.5 -> 0.25 px\n"
      "with all of them: sigma of the projection 0.25 px\n";
  EXPECT_EQ(NextViewsText(next, rig, {}, false),
            "8 frames; sigma of the projection 0.5 px, goal 0.1 px\n" + view);
  next.bound = ViewBound{.sigma = 0.3, .further = 4.2};
  next.suggested = 7;
  next.exhausted = true;
  EXPECT_EQ(ViewBoundText(next),
            "the best 8 frames possible would reach 0.3 px; the goal takes at least 5 more, 7 as "
            "suggested");
  EXPECT_EQ(NextViewsText(next, rig, Verdict{.grade = Grade::kBad, .findings = {}}, false),
            "8 frames; sigma of the projection 0.5 px, goal 0.1 px\n" + ViewBoundText(next) +
                "\nmore views of this target at these distances add little; allow nearer ones "
                "(--near), or take a larger target:\n" +
                view + "the calibration so far is bad, and more views may not help\n");
  next.bound->sigma = next.bound->further = std::numeric_limits<double>::infinity();
  EXPECT_EQ(ViewBoundText(next), "no number of these views reaches the goal");
  next.bound = ViewBound{.further = 0.2};
  next.suggested.reset();
  EXPECT_EQ(ViewBoundText(next), "the goal takes at least 1 more");
  next.reached = true;
  EXPECT_EQ(ViewBoundText(next), "");
  EXPECT_EQ(
      NextViewsText(next,
                    rig,
                    Verdict{.grade = Grade::kUsable, .findings = {{.code = {}, .what = "x"}}},
                    false),
      "8 frames; sigma of the projection 0.5 px, goal 0.1 px\nthe goal is reached; these views "
      "would add most:\n" +
          view);
  next = {};
  next.sigma = std::numeric_limits<double>::infinity(), next.frames = 1;
  next.views = {ViewOf(0, 0, 0, 0.5)};
  next.views[0].criterion = ViewCriterion::kEntropy;
  const std::string open =
      "  1. target in the upper right corner, 50 cm away, facing the camera: determines what the "
      "images so far leave open\n";
  EXPECT_EQ(NextViewsText(next, rig, {}, true),
            "1 frame; they do not determine all parameters yet\n" + open);
  EXPECT_EQ(
      NextViewsText(
          next, rig, Verdict{.grade = Grade::kBad, .findings = {{.code = {}, .what = "y"}}}, false),
      "1 frame; they do not determine all parameters yet, so distances are uncertain as well: "
      "--angle DEGREES, the lens' horizontal field of view, makes them better\n" +
          open + "the calibration so far is bad, and more views may not help: y\n");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
