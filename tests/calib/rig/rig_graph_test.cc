// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/rig_graph.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <utility>
#include <vector>

#include "tests/calib/random.h"

namespace plenocal {
namespace TEST_FILE {

// A rig of cameras before targets, all with known poses.
struct World {
  std::vector<RigidTransform> T_camera_rig, T_first_target;
  std::vector<RigidTransform> T_rig_first;  // per frame

  [[nodiscard]] Sighting See(int frame, size_t camera, size_t target) const {
    return {
        frame,
        camera,
        target,
        T_camera_rig[camera] * T_rig_first[static_cast<size_t>(frame)] * T_first_target[target]};
  }
};

World MakeWorld(size_t cameras, size_t targets, int frames) {
  testing::Random random(5);
  const auto draw = [&] { return random.Uniform(-1, 1); };
  const auto pose = [&](double size) {
    return RigidTransform{ExpRotation({size * draw(), size * draw(), size * draw()}),
                          {draw(), draw(), 2 + draw()}};
  };
  World world;
  world.T_camera_rig.emplace_back();
  for (size_t c = 1; c < cameras; ++c) world.T_camera_rig.push_back(pose(1.5));
  world.T_first_target.emplace_back();
  for (size_t k = 1; k < targets; ++k) world.T_first_target.push_back(pose(1));
  for (int f = 0; f < frames; ++f) world.T_rig_first.push_back(pose(0.6));
  return world;
}

constexpr double kRounding = 1e-6;

void ExpectCameras(const RigGraph& graph, const World& world, const std::vector<size_t>& cameras) {
  for (const size_t c : cameras) {
    EXPECT_EQ(graph.camera_group[c], graph.camera_group[0]) << c;
    const RigidTransform T = graph.T_camera_group[c] * graph.T_camera_group[0].Inverse();
    EXPECT_LT((T.t - world.T_camera_rig[c].t).norm(), kRounding) << c;
    EXPECT_LT((T.R - world.T_camera_rig[c].R).norm(), kRounding) << c;
  }
}

TEST(RigGraph, JoinsByCommonTargetsAndCamerasAcrossAChain) {
  const World world = MakeWorld(3, 2, 4);
  // 0 and 1 see target 0 together, 1 sees both targets, 2 sees target 1 beside 1.
  const std::vector<Sighting> seen{world.See(0, 0, 0),
                                   world.See(0, 1, 0),
                                   world.See(1, 1, 0),
                                   world.See(1, 1, 1),
                                   world.See(2, 1, 1),
                                   world.See(2, 2, 1)};
  const RigGraph graph = LinkRig(seen, 3, std::vector<GraphTarget>(2), {});
  ASSERT_EQ(graph.camera_group.size(), 3U);
  ASSERT_EQ(graph.target_group.size(), 2U);
  ExpectCameras(graph, world, {1, 2});
  EXPECT_EQ(graph.target_group[1], 0U);
  EXPECT_LT((graph.T_group_target[1].t - world.T_first_target[1].t).norm(), kRounding);
}

TEST(RigGraph, JoinsByMotionCamerasThatShareNoTarget) {
  const World world = MakeWorld(4, 2, 12);
  std::vector<Sighting> seen;
  // 0 sees target 0 while 1 sees target 1; then 2 and 3 likewise with 0.
  for (int f = 0; f < 8; ++f) {
    seen.push_back(world.See(f, 0, 0));
    seen.push_back(world.See(f, 1, 1));
  }
  for (int f = 8; f < 10; ++f) {
    seen.push_back(world.See(f, 2, 0));
    seen.push_back(world.See(f, 1, 1));
  }
  for (int f = 10; f < 12; ++f) {
    seen.push_back(world.See(f, 0, 1));
    seen.push_back(world.See(f, 3, 0));
  }
  const RigGraph graph = LinkRig(seen, 4, std::vector<GraphTarget>(2), {});
  ExpectCameras(graph, world, {1, 2, 3});
  EXPECT_EQ(graph.links.front().by, RigLink::By::kMotion);
  EXPECT_EQ(graph.links.front().frames, 8U);
  EXPECT_EQ(graph.links.size(), 3U);
}

TEST(RigGraph, LeavesApartWhatNothingJoins) {
  const World world = MakeWorld(2, 1, 6);
  std::vector<Sighting> seen;
  for (int f = 0; f < 6; ++f) seen.push_back(world.See(f, f < 3 ? 0 : 1, 0));
  const RigGraph graph = LinkRig(seen, 2, std::vector<GraphTarget>(1), {});
  EXPECT_NE(graph.camera_group[0], graph.camera_group[1]);
  // An earlier calibration holds their extrinsics.
  const std::vector<std::optional<RigidTransform>> earlier{RigidTransform{}, world.T_camera_rig[1]};
  ExpectCameras(LinkRig(seen, 2, std::vector<GraphTarget>(1), earlier), world, {1});
}

TEST(RigGraph, DoesNotTakeAMovingTargetForAFixedOne) {
  const World world = MakeWorld(2, 2, 6);
  std::vector<Sighting> seen;
  for (int f = 0; f < 6; ++f) {
    seen.push_back(world.See(f, 0, 0));
    seen.push_back(world.See(f, 1, 1));
  }
  const std::vector<GraphTarget> targets{{.moves = true, .known = {}},
                                         {.moves = true, .known = {}}};
  const RigGraph graph = LinkRig(seen, 2, targets, {});
  EXPECT_NE(graph.camera_group[0], graph.camera_group[1]);
  EXPECT_NE(graph.target_group[0], graph.target_group[1]);
}

}  // namespace TEST_FILE
}  // namespace plenocal
