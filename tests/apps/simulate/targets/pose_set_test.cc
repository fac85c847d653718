// SPDX-License-Identifier: Apache-2.0
//
// Poses of a rig before targets: what each kind promises, by formulas and for existing seeds.
#include "apps/simulate/targets/pose_set.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "apps/simulate/spec/random.h"
#include "apps/simulate/targets/hand_path.h"
#include "apps/simulate/targets/several_targets.h"
#include "calib/base/error.h"
#include "calib/camera/marker_id.h"
#include "tests/apps/simulate/small_scene.h"
#include "tests/apps/workspace.h"
#include "tests/refusal.h"

namespace plenocal::simulate {
namespace TEST_FILE {

using Eigen::Vector3d;
using ::plenocal::testing::Workspace;

constexpr double kPi = std::numbers::pi;

// 5 x 4 markers, 30 mm apart, seen from -z.
TrueTarget Plane() {
  TrueTarget target;
  for (int i = 0; i < 20; ++i) {
    target.markers[i] = Vector3d(0.03 * (i % 5), 0.03 * (i / 5), 0);
    target.normals[i] = {0, 0, -1};
  }
  return target;
}
const Vector3d kMiddle(0.06, 0.045, 0);

SimulationSpec Posed(const PoseSpec& poses) {
  SimulationSpec spec = SmallScene();
  spec.scenery.reset();
  spec.targets.resize(1);
  spec.cameras[1].params[0] = spec.cameras[1].params[1] = 40;  // the wider one
  spec.poses = poses;
  return spec;
}
PoseSpec Varied(int frames = 10) {
  PoseSpec poses;
  poses.frames = frames;
  poses.nearest = 0.3;
  poses.farthest = 0.6;
  return poses;
}

double DigestOf(const std::vector<Frame>& frames) {
  Digest digest;
  for (const Frame& frame : frames) digest.Add(frame.T_rig_target);
  return digest.Sum();
}
std::string Kinds(const std::vector<Frame>& frames) {
  std::string text;
  for (const Frame& frame : frames) text += frame.kind[0];
  return text;
}
// Angle between the target's normal and the ray to its middle, and its distance from the camera.
std::pair<double, double> TiltAndDistance(const CameraSpec& camera,
                                          const RigidTransform& T_rig_target) {
  const RigidTransform T = camera.T_camera_rig * T_rig_target;
  const Vector3d middle = T * kMiddle;
  return {std::acos(std::clamp(T.R.col(2).dot(middle.normalized()), -1.0, 1.0)), middle.norm()};
}

TEST(PoseSet, OfVariedPosesHasThemInTheRangesAndSomeAtTheRim) {
  const SimulationSpec spec = Posed(Varied(20));
  const Observer observer(spec);
  const std::vector<Frame> frames = MakePoses(spec, observer, {Plane()});
  ASSERT_EQ(frames.size(), 20u);
  EXPECT_EQ(Kinds(frames), "ggggpggggpggggpggggp");  // every fifth one
  EXPECT_EQ(frames[3].name, "000115");
  for (const Frame& frame : frames) {
    const bool partial = frame.kind == "partial";
    const CameraSpec& camera = spec.cameras[partial ? 1 : 0];
    const auto [tilt, distance] = TiltAndDistance(camera, frame.T_rig_target);
    EXPECT_TRUE(tilt >= 0 && tilt <= 0.7) << tilt;
    EXPECT_TRUE(distance >= 0.3 && distance <= 0.6) << distance;
    EXPECT_GE(CountMarkers(observer.Observe(partial ? 1 : 0, Plane(), frame.T_rig_target)), 8);
    Eigen::Vector2d u;
    camera.model->Project(camera.params.data(),
                          nullptr,
                          nullptr,
                          camera.T_camera_rig * (frame.T_rig_target * kMiddle),
                          u.data());
    const Eigen::Vector2d share(u.x() / 63, u.y() / 47);
    const double rim = std::min(share.minCoeff(), 1 - share.maxCoeff());
    if (partial) {
      EXPECT_TRUE(rim > 0.019 && rim < 0.121) << rim;
    } else {
      EXPECT_GE(rim, 0.199);
    }
    EXPECT_TRUE(frame.T_rig_target_of_camera.empty());
    EXPECT_EQ(&frame.PoseFor(1), &frame.T_rig_target);
  }
  EXPECT_NEAR(DigestOf(frames), 0.5735452638, 1e-6);
  // The first frame by the draws of its stream.
  Random random(5, "pose", {0});
  bool found = false;
  for (int i = 0; i < 20 && !found; ++i) {
    const double y = random.Uniform(0.2, 0.8), x = random.Uniform(0.2, 0.8);
    const double distance = 1 / random.Uniform(1 / 0.6, 1 / 0.3),
                 tilt = 0.7 * std::sqrt(random.Uniform(0, 1));
    const double azimuth = random.Uniform(-0.5, 0.5), roll = random.Uniform(-0.6, 0.6);
    const auto ray = observer.CentralRay(0, {63 * x, 47 * y});
    const Eigen::Matrix3d to_ray =
        Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), ray->direction).toRotationMatrix();
    const Eigen::Matrix3d R =
        to_ray * ExpRotation(tilt * Vector3d(std::cos(azimuth), std::sin(azimuth), 0)) *
        ExpRotation({0, 0, roll});
    found = (R - frames[0].T_rig_target.R).norm() < 1e-9 &&
            (frames[0].T_rig_target * kMiddle - distance * ray->direction).norm() < 1e-9;
  }
  EXPECT_TRUE(found);
}

TEST(PoseSet, OfBadKindsIsBadInItsOwnWay) {
  PoseSpec poses = Varied();
  poses.one_distance = true;
  SimulationSpec spec = Posed(poses);
  const Observer observer(spec);
  const auto make = [&] { return MakePoses(spec, observer, {Plane()}); };
  for (const Frame& frame : make()) EXPECT_NEAR((frame.T_rig_target * kMiddle).z(), 0.45, 1e-9);
  EXPECT_EQ(Kinds(make()), "gggggggggg");
  EXPECT_NEAR(DigestOf(make()), 1.1908152668, 1e-6);

  spec.poses = Varied();
  spec.poses.no_tilt = true;
  for (const Frame& frame : make()) EXPECT_NEAR(frame.T_rig_target.R(2, 2), 1, 1e-12);
  EXPECT_EQ(Kinds(make()), "gggggggggg");
  EXPECT_NEAR(DigestOf(make()), -0.1289196922, 1e-6);

  spec.poses = Varied();
  spec.poses.corner = true;
  for (const Frame& frame : make()) {
    EXPECT_EQ(frame.kind, "good");
    for (const Observation& o : observer.Observe(0, Plane(), frame.T_rig_target)) {
      EXPECT_TRUE(o.values[0] <= 31.5 && o.values[1] <= 23.5);
    }
  }
  EXPECT_NEAR(DigestOf(make()), -3.6876163141, 1e-6);
  spec.poses.nearest = spec.poses.farthest = 0.1;
  EXPECT_EQ(
      testing::RefusalOf([&] { make(); }, ErrorKind::kJob),
      "spec.yaml: poses: in 300 tries camera left never saw 8 markers in a corner of its image and none "
      "elsewhere; correct distance, tilt or the camera");
  spec.poses.corner = false;
  spec.poses.nearest = spec.poses.farthest = 0.01;
  EXPECT_THROW(make(), Error);

  spec.poses = Varied();
  spec.poses.still = true;
  const std::vector<Frame> still = make();
  ASSERT_EQ(still.size(), 10u);
  for (const Frame& frame : still) EXPECT_EQ(frame.T_rig_target.t, still[0].T_rig_target.t);
  EXPECT_EQ(still[9].name, "000145");
  EXPECT_EQ(still[9].kind, "good");

  spec.poses.given = {{"x", {ExpRotation({0, 0, 1}), {1, 2, 3}}}};
  const std::vector<Frame> given = make();
  ASSERT_EQ(given.size(), 1u);
  EXPECT_EQ(given[0].name + given[0].kind, "xgiven");
  EXPECT_LT((given[0].T_rig_target * Vector3d(1, 2, 3)).norm(), 1e-12);
}

TEST(PoseSet, OfSeveralCamerasAndTargetsGivesEachItsTurn) {
  PoseSpec poses = Varied(8);
  poses.aim_all = true;
  SimulationSpec spec = Posed(poses);
  spec.targets.resize(2);
  TrueTarget far = Plane();
  for (auto& [number, position] : far.markers) position += Vector3d(5, 0, 0);
  const Observer observer(spec);
  const std::vector<TrueTarget> targets{Plane(), far};
  const std::vector<Frame> frames = MakePoses(spec, observer, targets);
  std::string seen;
  for (size_t f = 0; f < 8; ++f) {
    EXPECT_EQ(frames[f].kind, "good");
    const size_t aim = f % 2;
    for (size_t k = 0; k < 2; ++k) {
      if (CountMarkers(observer.Observe(aim, targets[k], frames[f].T_rig_target)) >= 8)
        seen += static_cast<char>('0' + k);
    }
  }
  EXPECT_EQ(seen, "01100110");
  EXPECT_NEAR(DigestOf(frames), -1.790829579, 1e-6);
}

TEST(PoseSet, OfARigThatMovesFollowsTheHandsPathAtEachCamerasTime) {
  PoseSpec poses = Varied(12);
  poses.moving = true;
  poses.rate = 10;
  SimulationSpec spec = Posed(poses);
  spec.cameras[1].time_offset = 0.02;
  spec.cameras[1].time_shift = 0.005;
  const Observer observer(spec);
  const std::vector<Frame> frames = MakePoses(spec, observer, {Plane()});
  ASSERT_EQ(frames.size(), 12u);
  const HandPath path(poses, 5);
  const auto expect = [&](const RigidTransform& T, double time) {
    const Placement placement = path.At(time);
    const auto ray = observer.CentralRay(0, {63 * placement.share.x(), 47 * placement.share.y()});
    EXPECT_LT((T * kMiddle - placement.distance * ray->direction).norm(), 1e-9);
    EXPECT_NEAR(TiltAndDistance(spec.cameras[0], T).first, placement.tilt, 1e-6);
  };
  for (size_t f = 0; f < 12; ++f) {
    EXPECT_DOUBLE_EQ(frames[f].time, static_cast<double>(f) / 10);
    EXPECT_EQ(frames[f].kind, "good");
    expect(frames[f].T_rig_target, frames[f].time);
    ASSERT_EQ(frames[f].T_rig_target_of_camera.size(), 2u);
    EXPECT_EQ(frames[f].PoseFor(0).t, frames[f].T_rig_target.t);
    expect(frames[f].PoseFor(1), frames[f].time + 0.025);
  }
  EXPECT_NEAR(DigestOf(frames), 0.3311192791, 1e-6);
}

TEST(HandPath, IsASumOfSinesOfEqualVelocities) {
  PoseSpec poses = Varied();
  poses.tilt = 0.5;
  poses.roll = 0.3;
  const HandPath path(poses, 8);
  std::array<std::function<double(double)>, 6> signals;
  for (size_t s = 0; s < 6; ++s) {
    Random random(8, "hand", {s});
    std::vector<std::array<double, 2>> sines;
    double sum = 0;
    for (int i = 0; i < 4; ++i) {
      const double hertz = random.Uniform(0.1, 0.8);
      sines.push_back({hertz, random.Uniform(0, 2 * kPi)});
      sum += 1 / hertz;
    }
    signals[s] = [sines, sum](double time) {
      double value = 0;
      for (const auto& [hertz, phase] : sines)
        value += std::sin(2 * kPi * hertz * time + phase) / hertz / sum;
      return value;
    };
  }
  for (const double time : {0.0, 0.7, 12.3}) {
    const Placement at = path.At(time);
    EXPECT_NEAR(at.share.x(), 0.5 + 0.35 * signals[0](time), 1e-12);
    EXPECT_NEAR(at.share.y(), 0.5 + 0.35 * signals[1](time), 1e-12);
    EXPECT_NEAR(1 / at.distance, 2.5 + (1 / 0.3 - 2.5) * signals[2](time), 1e-12);
    EXPECT_NEAR(at.tilt * std::cos(at.azimuth), 0.5 * signals[3](time), 1e-12);
    EXPECT_NEAR(at.tilt * std::sin(at.azimuth), 0.5 * signals[4](time), 1e-12);
    EXPECT_NEAR(at.roll, 0.3 * signals[5](time), 1e-12);
    poses.one_distance = poses.no_tilt = true;
    EXPECT_DOUBLE_EQ(HandPath(poses, 8).At(time).distance, 0.45);
    EXPECT_EQ(HandPath(poses, 8).At(time).tilt, 0);
    poses.one_distance = poses.no_tilt = false;
  }
}

class SeveralTargets : public Workspace {
 protected:
  SimulationSpec Two() {
    Write("a.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 3\nrows: 2\nsquare: 0.1\n");
    Write("b.yaml",
          "plenocal: 1\ntype: chessboard\ncolumns: 2\nrows: 2\nsquare: 0.2\ntolerance: 0.01\n");
    SimulationSpec spec = Posed(Varied());
    spec.targets = {{"a", Path("a.yaml"), {}},
                    {"b", Path("b.yaml"), {ExpRotation({0, 0, kPi / 2}), {1, 0, 0}}}};
    return spec;
  }
};

TEST_F(SeveralTargets, AreOneWithNumbersOfTheirOwn) {
  const SimulationSpec spec = Two();
  const std::vector<TargetInRoom> targets = MakeTargets(spec);
  ASSERT_EQ(targets.size(), 2u);
  EXPECT_EQ(targets[0].made.markers, targets[0].target.markers);  // no tolerance
  double largest = 0;
  for (const auto& [number, position] : targets[1].made.markers) {
    largest = std::max(largest, (position - targets[1].target.markers.at(number)).norm());
  }
  EXPECT_TRUE(largest > 0.005 && largest < 0.06);
  EXPECT_EQ(targets[1].made.markers,
            MakeTarget(targets[1].target, 0.01, TagErrors::kRigid, 5 + 7919).markers);
  const TrueTarget together = Together(targets);
  EXPECT_EQ(together.markers.size(), 10u);
  for (const auto& [number, position] : targets[1].made.markers) {
    const int own = MarkerId{1, number}.Number();
    EXPECT_LT(
        (together.markers.at(own) - Vector3d(1 - position.y(), position.x(), position.z())).norm(),
        1e-12);
    EXPECT_LT((together.normals.at(own) - Vector3d(0, 0, -1)).norm(), 1e-12);
    EXPECT_EQ(InFrameOfFirst(targets[1], 1).markers.at(own), together.markers.at(own));
  }
  const Target stated = StatedTogether(targets);
  EXPECT_EQ(stated.markers.size(), 10u);
  EXPECT_LT((stated.markers.at(MarkerId{1, 1}.Number()) - Vector3d(1, 0.2, 0)).norm(), 1e-12);
  EXPECT_LT((stated.markers.at(MarkerId{0, 1}.Number()) - Vector3d(0.1, 0, 0)).norm(), 1e-12);
  EXPECT_EQ(TargetsOfSession(targets), "targets:\n  a: target_a.yaml\n  b: target_b.yaml\n");
  EXPECT_EQ(TargetFile(targets[1]), "target_b.yaml");
  // Both boards are there.
  const PosedSurface posed(JoinSurfaces(targets, 1), {Eigen::Matrix3d::Identity(), {0, 0, 2}});
  static_cast<void>(posed);

  SimulationSpec one = spec;
  one.targets = {{"", Path("b.yaml"), {}}};
  one.target_error = 0;
  const std::vector<TargetInRoom> only = MakeTargets(one);
  EXPECT_TRUE(only[0].IsOnlyOne());
  EXPECT_EQ(only[0].made.markers, only[0].target.markers);
  EXPECT_EQ(TargetsOfSession(only), "target: target.yaml\n");
  EXPECT_EQ(Together(only).markers, only[0].made.markers);
  EXPECT_EQ(StatedTogether(only).tolerance, 0.01);
}

}  // namespace TEST_FILE
}  // namespace plenocal::simulate
