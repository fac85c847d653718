// SPDX-License-Identifier: Apache-2.0
//
// Paths of a rig against their formulas, with phases drawn from the seed in the documented order.
#include "apps/simulate/scene/rig_path.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "apps/simulate/spec/random.h"

namespace plenocal::simulate {
namespace TEST_FILE {

using Eigen::Vector3d;
using ::testing::ElementsAre;

constexpr double kPi = std::numbers::pi;
constexpr int kSeed = 9;

// Three sines with phases of a stream.
struct Waves {
  Vector3d frequencies, phases;
  Waves(const Vector3d& hertz, Random* random) : frequencies(hertz) {
    for (double& phase : phases) phase = random->Uniform(0, 2 * kPi);
  }
  [[nodiscard]] Vector3d At(double time) const {
    Vector3d values;
    for (int i = 0; i < 3; ++i) values[i] = std::sin(2 * kPi * frequencies[i] * time + phases[i]);
    return values;
  }
};

// The two waves of a path and the shake of the hand.
struct Motion {
  Random random{kSeed, "path"};
  Waves first, second;
  std::vector<Waves> translations, rotations;
  double shake;

  Motion(const Vector3d& of_first, const Vector3d& of_second, double scale)
      : first(of_first, &random), second(of_second, &random), shake(scale) {
    for (const double hertz : {0.7, 1.3, 2.9, 5.1}) {
      const Vector3d each = hertz * Vector3d(1, 1.17, 0.86);
      translations.emplace_back(each, &random);
      rotations.emplace_back(1.07 * each, &random);
    }
  }
  [[nodiscard]] Vector3d Translation(double time) const {
    return shake * (0.008 * translations[0].At(time) + 0.005 * translations[1].At(time) +
                    0.002 * translations[2].At(time) + 0.0005 * translations[3].At(time));
  }
  [[nodiscard]] Eigen::Matrix3d Rotation(double time) const {
    return ExpRotation(shake * (0.017 * rotations[0].At(time) + 0.01 * rotations[1].At(time) +
                                0.004 * rotations[2].At(time) + 0.0014 * rotations[3].At(time)));
  }
};

// A camera that looks along a horizontal direction: x to the right, y down.
Eigen::Matrix3d Look(double heading) {
  Eigen::Matrix3d R;
  R << std::sin(heading), 0, std::cos(heading), -std::cos(heading), 0, std::sin(heading), 0, -1, 0;
  return R;
}

void ExpectPose(const RigInstant& instant, const Eigen::Matrix3d& R, const Vector3d& t) {
  EXPECT_LT((instant.T_world_rig.t - t).norm(), 1e-9) << instant.name;
  EXPECT_LT((instant.T_world_rig.R - R).norm(), 1e-9) << instant.name;
}

TrajectorySpec Loop() {
  TrajectorySpec spec;
  spec.length = 20;
  spec.speed = 2;
  spec.rate = 5;
  spec.segment = 3;
  spec.overlap = 0.5;
  spec.seconds = 4;
  return spec;
}

TEST(RigPath, OfALoopIsWoundAroundACircle) {
  for (const bool one_depth : {false, true}) {
    TrajectorySpec spec = Loop();
    spec.one_depth = one_depth;
    if (one_depth) spec.amplitude = 0.25;
    const RigPath path = MakeRigPath(spec, 2, 6, kSeed);
    EXPECT_DOUBLE_EQ(path.circumference, 20 - 0.5 * 6);
    ASSERT_EQ(path.instants.size(), 51u);  // 10 s
    const Motion motion(Vector3d(0.73, 0.73, 1) / 4, Vector3d(0.61, 0.45, 0.37) / 4, 1);
    const double radius = 17 / (2 * kPi), amplitude = one_depth ? 0.25 : 0.6;
    for (size_t i = 0; i < path.instants.size(); ++i) {
      const RigInstant& instant = path.instants[i];
      const double time = static_cast<double>(i) / 5, heading = 2 * time / radius - kPi / 2;
      EXPECT_DOUBLE_EQ(instant.time, time);
      const Vector3d out(std::cos(heading), std::sin(heading), 0), wound = motion.first.At(time);
      ExpectPose(instant,
                 Look(heading) *
                     ExpRotation(motion.second.At(time).cwiseProduct(Vector3d(0.06, 0.12, 0.06))) *
                     motion.Rotation(time),
                 radius * out + amplitude * wound.z() * Vector3d::UnitZ() +
                     (one_depth ? 0 : amplitude / 2) * wound.x() * out + motion.Translation(time));
    }
    EXPECT_EQ(path.instants[7].name, "000007");
  }
}

TEST(RigPath, OfALoopMayBeStraightAtStartAndEndOrStayInItsPlace) {
  TrajectorySpec spec = Loop();
  spec.straight = true;
  spec.amplitude = 5;  // not along straight sides
  spec.shake = 0;
  const RigPath path = MakeRigPath(spec, 2, 6, kSeed);
  const double radius = (17 - 2 * 6) / (2 * kPi), half = 17 / 2.0;
  for (const RigInstant& instant : path.instants) {
    const double s = std::fmod(2 * instant.time, 17);
    const double along = s < half ? s : s - half, sign = s < half ? 1 : -1;
    const double angle = (along - 6) / radius - kPi / 2;
    const Vector3d t = along < 6
                           ? Vector3d(along - 3, -radius, 0)
                           : Vector3d(3 + radius * std::cos(angle), radius * std::sin(angle), 0);
    EXPECT_LT((instant.T_world_rig.t - sign * t).norm(), 1e-9) << instant.name;
  }
  spec.straight = false;
  spec.rotation = true;
  for (const RigInstant& instant : MakeRigPath(spec, 2, 6, kSeed).instants) {
    EXPECT_EQ(instant.T_world_rig.t, Vector3d::Zero());
    EXPECT_EQ(instant.velocity, Vector3d::Zero());
  }
  spec = Loop();
  spec.no_overlap = true;
  EXPECT_EQ(MakeRigPath(spec, 2, 6, kSeed).circumference, 40);  // half of the way round
}

TEST(RigPath, OfAHandGoesToAndFroInEachAxis) {
  TrajectorySpec spec;
  spec.shape = TrajectorySpec::Shape::kHandheld;
  spec.rate = 15;
  spec.frames = 7;
  spec.shake = 2;
  spec.turn = 0.3;
  spec.roll = 0.5;
  // Amplitude and reach forwards by near, far and the kinds.
  struct Case {
    double near, far;
    bool one_depth;
    std::optional<double> given;
    double amplitude, forward;
  };
  for (const Case& c : std::initializer_list<Case>{
           {2, 8, false, {}, 1, 0.8}, {2, 8, true, {}, 0.4, 0}, {2, 8, false, 0.3, 0.3, 0.3}}) {
    spec.one_depth = c.one_depth;
    spec.amplitude = c.given;
    const RigPath path = MakeRigPath(spec, c.near, c.far, kSeed);
    EXPECT_EQ(path.circumference, 0);
    ASSERT_EQ(path.instants.size(), 7u);
    const double seconds = 7 * 8.0 / 15;  // 8 frames of the camera for 7.5
    const Motion motion(Vector3d(3.1, 4.3, 5.3) / seconds, Vector3d(4.7, 3.7, 2.3) / seconds, 2);
    for (size_t i = 0; i < 7; ++i) {
      const RigInstant& instant = path.instants[i];
      const double time = static_cast<double>(8 * i) / 15;
      EXPECT_DOUBLE_EQ(instant.time, time);
      EXPECT_TRUE(instant.used && instant.part == Part::kStart);
      ExpectPose(
          instant,
          Look(0) * ExpRotation(motion.second.At(time).cwiseProduct(Vector3d(0.3, 0.3, 0.5))) *
              motion.Rotation(time),
          motion.first.At(time).cwiseProduct(Vector3d(c.forward, c.amplitude, 0.7 * c.amplitude)) +
              motion.Translation(time));
    }
    EXPECT_EQ(path.instants[6].name, "000048");
  }
  spec.no_turning = true;
  for (const RigInstant& each : MakeRigPath(spec, 2, 8, kSeed).instants) {
    EXPECT_EQ(each.T_world_rig.R, Look(0).array().round().matrix());
  }
  spec.no_turning = false;
  spec.rotation = true;
  for (const RigInstant& each : MakeRigPath(spec, 2, 8, kSeed).instants) {
    EXPECT_EQ(each.T_world_rig.t, Vector3d::Zero());
  }
  // At less than a frame a second every frame is taken.
  spec.rate = 0.5;
  const RigPath slow = MakeRigPath(spec, 2, 8, kSeed);
  EXPECT_EQ(slow.instants[2].name, "000002");
  EXPECT_EQ(slow.instants[2].time, 4);
}

// A path along x at 0, 1, 2, ... s, at x = t^2.
TrajectorySpec Given(size_t count) {
  TrajectorySpec spec;
  spec.shape = TrajectorySpec::Shape::kGiven;
  spec.segment = 3;
  for (size_t i = 0; i < count; ++i) {
    const auto t = static_cast<double>(i);
    spec.given.times.push_back(10 + t);
    spec.given.positions.emplace_back(t * t, 1, 2);
    spec.given.orientations.emplace_back(Eigen::AngleAxisd(0.1 * t, Vector3d::UnitY()));
  }
  return spec;
}

std::string Parts(const RigPath& path) {
  std::string text;
  for (const RigInstant& instant : path.instants) {
    const char part = "sbe"[static_cast<int>(instant.part)];
    text += instant.used ? static_cast<char>(std::toupper(part)) : part;
  }
  return text;
}

TEST(RigPath, IsTheGivenOneInSegments) {
  TrajectorySpec spec = Given(10);
  const RigPath path = MakeRigPath(spec, 1, 2, 1);
  EXPECT_EQ(path.circumference, 0);
  EXPECT_EQ(Parts(path), "SSSSbbEEEE");  // both limits belong to the segments
  EXPECT_EQ(path.instants[3].name, "000003");
  EXPECT_EQ(path.instants[3].time, 13);
  ExpectPose(path.instants[3], ExpRotation({0, 0.3, 0}), {9, 1, 2});
  EXPECT_DOUBLE_EQ(path.instants[0].velocity.x(), 1);   // to the next
  EXPECT_DOUBLE_EQ(path.instants[4].velocity.x(), 8);   // from 9 to 25 in 2 s
  EXPECT_DOUBLE_EQ(path.instants[9].velocity.x(), 17);  // from the one before
  std::vector<std::string> used;
  for (const RigInstant* instant : path.Used()) used.push_back(instant->name);
  EXPECT_THAT(
      used,
      ElementsAre("000000", "000001", "000002", "000003", "000006", "000007", "000008", "000009"));

  spec.frames = 2;
  EXPECT_EQ(Parts(MakeRigPath(spec, 1, 2, 1)), "SssSbbEeeE");
  spec.frames = 3;
  EXPECT_EQ(Parts(MakeRigPath(spec, 1, 2, 1)), "SSsSbbEEeE");
  spec.frames = 4;
  EXPECT_EQ(Parts(MakeRigPath(spec, 1, 2, 1)), "SSSSbbEEEE");
  spec.whole = true;
  spec.frames = 2;
  EXPECT_EQ(Parts(MakeRigPath(spec, 1, 2, 1)), "SSSSBBEEEE");
  // Segments that overlap: the start has the frames.
  EXPECT_EQ(Parts(MakeRigPath(Given(5), 1, 2, 1)), "SSSSE");
  const RigPath single = MakeRigPath(Given(1), 1, 2, 1);
  EXPECT_EQ(Parts(single), "S");
  EXPECT_EQ(single.instants[0].velocity, Vector3d::Zero());
}

}  // namespace TEST_FILE
}  // namespace plenocal::simulate
