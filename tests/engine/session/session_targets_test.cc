// SPDX-License-Identifier: Apache-2.0
#include "engine/session/session_targets.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "models/registry.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const std::string kGrid = "aprilgrid:2x1:40mm:0.5:tag36h11";

Session SessionOf(const std::string& keys) {
  return ParseSession(
      "plenocal: 1\n" + keys +
          "cameras:\n  left: {model: pinhole, detections: left.csv, image_size: [9, 9]}\n",
      "s.yaml",
      CameraModels());
}

std::string Refusal(const std::string& keys) {
  return RefusalOf([&] { ReadSessionTargets(SessionOf(keys)); });
}

ScenePosition Position(const std::string& name, std::vector<int> points) {
  return {.name = name, .points = std::move(points)};
}

TEST(SessionTargets, HavePositionsByTheirMarkers) {
  const Target board = TargetOfWord("chessboard:3x2:25mm"), grid = TargetOfWord(kGrid);
  EXPECT_TRUE(HasPosition(board, Position("marker 5", {5})));
  EXPECT_FALSE(HasPosition(board, Position("marker 6", {6})));
  EXPECT_FALSE(HasPosition(board, Position("tag 0", {0, 1, 2, 3})));
  EXPECT_TRUE(HasPosition(grid, Position("tag 1", {4, 5, 6, 7})));
  EXPECT_FALSE(HasPosition(grid, Position("tag 2", {7, 8, 9, 10})));
  EXPECT_TRUE(HasPosition(grid, Position("marker 7", {7})));
}

TEST(SessionTargets, OfOneAreTheTarget) {
  const SessionTargets targets = ReadSessionTargets(SessionOf("target: chessboard:3x2:25mm\n"));
  EXPECT_THAT(targets.several, IsEmpty());
  EXPECT_EQ(targets.all.markers.size(), 6U);
  EXPECT_TRUE(std::holds_alternative<ChessboardLayout>(targets.all.layout));
}

TEST(SessionTargets, OfSeveralAreOneOfAllMarkers) {
  const auto read = [](const std::string& a, const std::string& b) {
    return ReadSessionTargets(SessionOf(
        fmt::format("targets:\n  wall: {{target: '{}'}}\n  board: {{target: '{}'}}\n", a, b)));
  };
  SessionTargets targets = read(kGrid + ":tolerance=0.1mm:scale_sigma=0.001",
                                "chessboard:3x2:25mm:tolerance=0.3mm:scale_sigma=0.002");
  ASSERT_EQ(targets.several.size(), 2U);
  EXPECT_EQ(targets.all.markers.size(), 8U + 6U);
  for (const int number : {0, 5}) {
    EXPECT_LT(
        (targets.all.markers.at(100'000 + number) - targets.several[1].markers.at(number)).norm(),
        1e-12);
    EXPECT_LT((targets.all.markers.at(number) - targets.several[0].markers.at(number)).norm(),
              1e-12);
  }
  EXPECT_EQ(targets.all.tolerance, 0.0003);
  ASSERT_EQ(targets.all.scales.size(), 2U);
  EXPECT_EQ(targets.all.scales[0].target, 0);
  EXPECT_EQ(targets.all.scales[0].sigma, 0.001);
  EXPECT_EQ(targets.all.scales[1].target, 1);
  EXPECT_EQ(targets.all.scales[1].sigma, 0.002);
  EXPECT_THAT(targets.identical_boards, IsEmpty());
  targets = read(kGrid + ":tolerance=0.1mm", "chessboard:3x2:25mm");
  EXPECT_EQ(targets.all.tolerance, std::nullopt);
  EXPECT_THAT(targets.all.scales, IsEmpty());
}

TEST(SessionTargets, OfSeveralNeedKnownLengthsAndSmallNumbers) {
  EXPECT_EQ(Refusal("targets:\n  a: {target: 'chessboard:3x2:25mm'}\n"
                    "  b: {target: 'chessboard:5x4:unknown'}\n"),
            "s.yaml: target b: 'square' must be known, as there are several targets");
  const auto markers = [](int last) {
    return fmt::format(
        "targets:\n  a: {{target: 'chessboard:3x2:25mm'}}\n  b:\n    target:\n"
        "      type: markers\n      markers: {{1: [0, 0, 0], 2: [1, 0, 0], 3: [0, 1, 0], {}: [1, 1, 0]}}\n",
        last);
  };
  EXPECT_EQ(Refusal(markers(99'999)), "no refusal");
  EXPECT_EQ(Refusal(markers(100'000)),
            "s.yaml: target b has a marker 100000; of several targets the numbers must be below "
            "100000");
}

TEST(SessionTargets, HaveTheMarkersOfDistances) {
  const std::string one = "target: 'aprilgrid:2x1:40mm:0.5:tag36h11'\n";
  const auto distances = [](const std::string& a, const std::string& b) {
    return fmt::format(
        "distances:\n  - {{between: ['{}', '{}'], length: 1.0, sigma: 0.001}}\n", a, b);
  };
  EXPECT_EQ(Refusal(one + distances("tag 0", "tag 1")), "no refusal");
  EXPECT_EQ(Refusal(one + distances("tag 0 corner 1", "marker 7")), "no refusal");
  EXPECT_THAT(Refusal(one + distances("tag 0", "tag 2")), EndsWith("the target has no tag 2"));
  EXPECT_THAT(Refusal(one + distances("marker 8", "tag 1")),
              EndsWith("the target has no marker 8"));
  EXPECT_THAT(Refusal("target: 'chessboard:3x2:25mm'\n" + distances("tag 0", "marker 1")),
              EndsWith("the target has no tag 0"));
  EXPECT_THAT(Refusal("target: 'chessboard:3x2:unknown'\n" + distances("marker 0", "marker 1")),
              EndsWith("'square' of the target is unknown; state it, and in 'scale_sigma' how far "
                       "it may be off"));
  const auto several = [](const std::string& pose_a, const std::string& pose_b) {
    return fmt::format(
        "targets:\n  wall: {{target: '{}'{}}}\n  board: {{target: "
        "'chessboard:3x2:25mm'{}}}\n",
        kGrid,
        pose_a,
        pose_b);
  };
  const std::string free = ", pose: free";
  EXPECT_EQ(Refusal(several("", "") + distances("wall: tag 1", "board: marker 5")), "no refusal");
  EXPECT_THAT(Refusal(several("", "") + distances("wall: tag 1", "board: marker 6")),
              EndsWith("the target has no board: marker 6"));
  const std::string moving =
      "one of the targets moves ('pose: free'), so that this is no fixed distance";
  EXPECT_THAT(Refusal(several("", free) + distances("wall: tag 1", "board: marker 5")),
              EndsWith(moving));
  EXPECT_THAT(Refusal(several("", free) + distances("board: marker 5", "wall: tag 1")),
              EndsWith(moving));
  EXPECT_EQ(Refusal(several("", free) + distances("board: marker 5", "board: marker 0")),
            "no refusal");
}

TEST(SessionTargets, OfSeveralAreRefusedByCommandsForOne) {
  Session session;
  session.path = "s.yaml";
  RefuseSeveralTargets(session, "try");
  session.targets.emplace_back();
  EXPECT_EQ(RefusalOf([&] { RefuseSeveralTargets(session, "try"); }),
            "s.yaml: 'try' takes sessions with one target; name it as 'target' in a session of its "
            "own");
}

TEST(SessionTargets, AreInputWithTheirPoses) {
  Session session;
  EXPECT_THAT(InputTargetsOf(session), IsEmpty());
  const RigidTransform known{ExpRotation({0.1, 0.2, 0.3}), {1, 2, 3}};
  for (const char* name : {"a", "b", "c"}) session.targets.emplace_back().name = name;
  session.targets[1].moves = true;
  session.targets[2].known = known;
  const std::vector<InputTarget> targets = InputTargetsOf(session);
  ASSERT_EQ(targets.size(), 3U);
  EXPECT_EQ(targets[1].name, "b");
  EXPECT_FALSE(targets[0].moves);
  EXPECT_TRUE(targets[1].moves);
  EXPECT_FALSE(targets[1].known);
  EXPECT_EQ(targets[2].known->t, known.t);
}

TEST(SessionTargets, JoinTheirViewsByFrame) {
  const auto view = [](const std::string& frame, std::vector<int> markers, double moved) {
    View made{.frame = frame, .observations = {}};
    for (const int marker : markers) {
      made.observations.push_back({.marker = marker, .values = {1.0 * marker, moved}});
      made.by_nuisance.push_back({moved});
    }
    return made;
  };
  const std::vector<View> views = JoinViews(
      {{view("f2", {1, 2}, 0), view("f1", {3}, 0)}, {view("f3", {4}, 1), view("f2", {1}, 1)}});
  std::vector<std::string> shown;
  for (const View& each : views) {
    ASSERT_EQ(each.by_nuisance.size(), each.observations.size());
    for (size_t i = 0; i < each.observations.size(); ++i) {
      shown.push_back(fmt::format("{} {} {} {}",
                                  each.frame,
                                  each.observations[i].marker,
                                  each.observations[i].values[0],
                                  each.by_nuisance[i][0]));
    }
  }
  EXPECT_THAT(shown,
              ElementsAre("f1 3 3 0", "f2 1 1 0", "f2 2 2 0", "f2 100001 1 1", "f3 100004 4 1"));
}

TEST(SessionTargets, ArePlacedTogetherAtTheirNominalPositions) {
  CalibrationRecord record;
  record.markers[3] = {.position = {0.1, 0.2, 0.3}};
  record.markers[4] = {.position = {1.123456789012, 0, 0}};
  record.markers[5] = {.position = {0, 1, 0}, .nominal = Eigen::Vector3d(0, 1.5, -2)};
  record.markers[6] = {.position = {0, 0, 1}};
  const Target target = PlacedTogether(record);
  EXPECT_EQ(target.markers.size(), 4U);
  EXPECT_EQ(target.markers.at(3), Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_NEAR(target.markers.at(4).x(), 1.123456789012, 1e-11);
  EXPECT_EQ(target.markers.at(5), Eigen::Vector3d(0, 1.5, -2));
  EXPECT_FALSE(target.tolerance);
}

TEST(SessionTargets, AreRefinedInTheirOwnFrames) {
  // The second target is turned by 90 degrees about z and shifted: x_own is y of the first.
  const RigidTransform T_target_own{ExpRotation({0, 0, std::acos(0.0)}), {10, 20, 30}};
  CalibrationRecord record;
  record.targets.resize(2);
  record.targets[1].T_target_own = T_target_own;
  const Target board = TargetOfWord("chessboard:3x2:1m");
  const auto refined = [&](int number, const Eigen::Vector3d& own) {
    MarkerRecord& marker = record.markers[100'000 + number];
    marker.position = T_target_own * own;
    marker.sigma = Eigen::Vector3d(1e-3, 2e-3, 3e-3);
  };
  refined(0, {0.25, 0.5, 0.125});
  refined(4, {1.25, 1.5, 0.25});
  record.markers[100'004].sigma.reset();
  record.markers[1] = {.position = {9, 9, 9}};  // of the first target
  const std::string text = RefinedTargetOf(record, board, 1);
  const Target found = ReadTarget(YamlNode::Parse(text, "refined"));
  EXPECT_LT((found.markers.at(0) - Eigen::Vector3d(0.25, 0.5, 0.125)).norm(), 1e-9);
  EXPECT_LT((found.markers.at(4) - Eigen::Vector3d(1.25, 1.5, 0.25)).norm(), 1e-9);
  EXPECT_LT((found.markers.at(1) - board.markers.at(1)).norm(), 1e-12);
  const auto sigma = YamlNode::Parse(text, "refined").At("sigma").Entries();
  ASSERT_EQ(sigma.size(), 1U);
  const std::vector<double> values = sigma[0].second.AsNumbers(3);
  EXPECT_NEAR(values[0], 2e-3, 1e-9);
  EXPECT_NEAR(values[1], 1e-3, 1e-9);
  EXPECT_NEAR(values[2], 3e-3, 1e-9);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
