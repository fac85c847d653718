// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/scene/rig_path.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "apps/simulate/spec/random.h"

namespace plenocal::simulate {
namespace {

constexpr double kPi = std::numbers::pi;

/// A smooth random function of time with three components within [-1, 1].
class Wave {
 public:
  /// `frequencies` in Hz, one a component; the phases are drawn.
  Wave(const Eigen::Vector3d& frequencies, Random* random) : frequencies_(frequencies) {
    for (int i = 0; i < 3; ++i) phases_[i] = random->Uniform(0, 2 * kPi);
  }
  [[nodiscard]] Eigen::Vector3d At(double time) const {
    return (2 * kPi * time * frequencies_ + phases_).array().sin();
  }

 private:
  Eigen::Vector3d frequencies_, phases_;
};

/// The shake of a hand: about 1 degree and 8 mm, slow, and less of each faster one.
class HandShake {
 public:
  HandShake(double scale, Random* random) : scale_(scale) {
    for (const double frequency : {0.7, 1.3, 2.9, 5.1}) {
      // No two components repeat together.
      const Eigen::Vector3d frequencies = frequency * Eigen::Vector3d(1, 1.17, 0.86);
      translations_.emplace_back(frequencies, random);
      rotations_.emplace_back(1.07 * frequencies, random);
    }
  }
  [[nodiscard]] RigidTransform At(double time) const {
    constexpr std::array kMetres{0.008, 0.005, 0.002, 0.0005};
    constexpr std::array kRadians{0.017, 0.01, 0.004, 0.0014};
    Eigen::Vector3d t = Eigen::Vector3d::Zero(), w = Eigen::Vector3d::Zero();
    for (size_t i = 0; i < kMetres.size(); ++i) {
      t += scale_ * kMetres[i] * translations_[i].At(time);
      w += scale_ * kRadians[i] * rotations_[i].At(time);
    }
    return {ExpRotation(w), t};
  }

 private:
  double scale_;
  std::vector<Wave> translations_, rotations_;
};

/// R_world_rig of a rig that faces a horizontal direction; its y axis points down.
Eigen::Matrix3d LookAlong(const Eigen::Vector3d& direction) {
  const Eigen::Vector3d down = -Eigen::Vector3d::UnitZ();
  Eigen::Matrix3d R;
  R << down.cross(direction), down, direction;
  return R;
}

/// A closed convex curve in the plane z = 0 about the origin.
class ClosedCurve {
 public:
  ClosedCurve(double circumference, double straight)
      : straight_(straight), radius_((circumference - 2 * straight) / (2 * kPi)) {}

  /// Pose at arc length `s`, m: on the curve, facing outwards.
  [[nodiscard]] RigidTransform At(double s) const {
    const double half = straight_ + kPi * radius_;
    const double along = std::fmod(s, 2 * half);
    const bool second = along >= half;
    const double rest = second ? along - half : along;
    RigidTransform T;
    // A straight side below the origin towards +x, then half a circle about its end.
    if (rest < straight_) {
      T.t = {rest - straight_ / 2, -radius_, 0};
      T.R = LookAlong(-Eigen::Vector3d::UnitY());
    } else {
      const double angle = (rest - straight_) / radius_ - kPi / 2;
      const Eigen::Vector3d outwards(std::cos(angle), std::sin(angle), 0);
      T.t = Eigen::Vector3d(straight_ / 2, 0, 0) + radius_ * outwards;
      T.R = LookAlong(outwards);
    }
    const RigidTransform half_turn{ExpRotation({0, 0, kPi}), Eigen::Vector3d::Zero()};
    return second ? half_turn * T : T;
  }

 private:
  double straight_, radius_;  // m
};

std::string InstantName(size_t number) { return fmt::format("{:06}", number); }

double Circumference(const TrajectorySpec& spec) {
  const double segment = spec.segment * spec.speed;
  return spec.no_overlap ? 2 * spec.length : spec.length - spec.overlap * segment;
}

RigPath LoopPath(const TrajectorySpec& spec, int seed) {
  RigPath path;
  path.circumference = Circumference(spec);
  const ClosedCurve curve(path.circumference, spec.straight ? spec.segment * spec.speed : 0);
  const double amplitude = spec.straight || spec.rotation ? 0 : spec.amplitude.value_or(0.6);
  const double towards = spec.one_depth ? 0 : 0.5;
  Random random(seed, "path");
  // Not in step with each other, so that the rig does not move along a line.
  const Wave winding(Eigen::Vector3d(0.73, 0.73, 1) / spec.seconds, &random);
  const Wave turning(Eigen::Vector3d(0.61, 0.45, 0.37) / spec.seconds, &random);
  const HandShake shake(spec.shake, &random);
  const Eigen::Vector3d largest_turn(0.06, 0.12, 0.06);  // rad: pitch, yaw, roll
  const auto count = static_cast<size_t>(spec.length / spec.speed * spec.rate) + 1;
  for (size_t i = 0; i < count; ++i) {
    const double time = static_cast<double>(i) / spec.rate;
    RigidTransform T = curve.At(spec.speed * time);
    const Eigen::Vector3d wound = winding.At(time);
    T.t += amplitude * (wound.z() * Eigen::Vector3d::UnitZ() + towards * wound.x() * T.R.col(2));
    const RigidTransform shaken = shake.At(time);
    T.R = T.R * ExpRotation(turning.At(time).cwiseProduct(largest_turn)) * shaken.R;
    T.t += shaken.t;
    if (spec.rotation) T.t.setZero();
    path.instants.push_back({InstantName(i), time, Part::kBetween, false, T});
  }
  return path;
}

RigPath HandheldPath(const TrajectorySpec& spec, double nearest, double farthest, int seed) {
  RigPath path;
  Random random(seed, "path");
  const auto count = static_cast<size_t>(*spec.frames);
  const double steps = std::round(spec.rate / 2);  // half a second from frame to frame
  const double seconds = static_cast<double>(count) * steps / spec.rate;
  // That many times to and fro in each axis during the recording.
  const Wave moving(Eigen::Vector3d(3.1, 4.3, 5.3) / seconds, &random);
  const Wave turning(Eigen::Vector3d(4.7, 3.7, 2.3) / seconds, &random);
  const HandShake shake(spec.shake, &random);
  const double share = spec.one_depth ? 0.1 : 0.25;
  const double amplitude = spec.amplitude.value_or(share * std::sqrt(nearest * farthest));
  // Forward: not into the nearest things, and not at all where the depth shall be one.
  const double forward = spec.one_depth ? 0 : std::min(amplitude, 0.4 * nearest);
  const Eigen::Vector3d reach(forward, amplitude, 0.7 * amplitude);
  const Eigen::Vector3d largest_turn(spec.turn, spec.turn, spec.roll);
  for (size_t i = 0; i < count; ++i) {
    const auto number = i * static_cast<size_t>(std::max(steps, 1.0));
    const double time = static_cast<double>(number) / spec.rate;
    const RigidTransform shaken = shake.At(time);
    RigidTransform T{LookAlong(Eigen::Vector3d::UnitX()), Eigen::Vector3d::Zero()};
    if (!spec.rotation) T.t = moving.At(time).cwiseProduct(reach) + shaken.t;
    if (!spec.no_turning) {
      T.R = T.R * ExpRotation(turning.At(time).cwiseProduct(largest_turn)) * shaken.R;
    }
    path.instants.push_back({InstantName(number), time, Part::kStart, true, T});
  }
  return path;
}

RigPath GivenPath(const Trajectory& given) {
  RigPath path;
  for (size_t i = 0; i < given.Size(); ++i) {
    path.instants.push_back({InstantName(i),
                             given.times[i],
                             Part::kBetween,
                             false,
                             {given.orientations[i].toRotationMatrix(), given.positions[i]}});
  }
  return path;
}

// Marks at most `frames` of the instants of one part, evenly spread.
void UseEvenly(std::vector<RigInstant*> instants, std::optional<int> frames) {
  const size_t most = frames ? static_cast<size_t>(*frames) : instants.size();
  if (instants.size() <= most) {
    for (RigInstant* instant : instants) instant->used = true;
    return;
  }
  for (size_t i = 0; i < most; ++i) {
    instants[i * (instants.size() - 1) / (most - 1)]->used = true;
  }
}

void MarkSegments(const TrajectorySpec& spec, RigPath* path) {
  const double first = path->instants.front().time, last = path->instants.back().time;
  std::vector<RigInstant*> start, end;
  for (RigInstant& instant : path->instants) {
    if (instant.time <= first + spec.segment) {
      instant.part = Part::kStart;
      start.push_back(&instant);
    } else if (instant.time >= last - spec.segment) {
      instant.part = Part::kEnd;
      end.push_back(&instant);
    }
    instant.used = spec.whole;
  }
  if (spec.whole) return;
  UseEvenly(std::move(start), spec.frames);
  UseEvenly(std::move(end), spec.frames);
}

// From the neighbours of each instant.
void FindVelocities(std::vector<RigInstant>* instants) {
  for (size_t i = 0; i < instants->size(); ++i) {
    const RigInstant& before = (*instants)[i == 0 ? 0 : i - 1];
    const RigInstant& after = (*instants)[std::min(i + 1, instants->size() - 1)];
    const double seconds = after.time - before.time;
    if (seconds > 0) {
      (*instants)[i].velocity = (after.T_world_rig.t - before.T_world_rig.t) / seconds;
    }
  }
}

}  // namespace

std::vector<const RigInstant*> RigPath::Used() const {
  std::vector<const RigInstant*> used;
  for (const RigInstant& instant : instants) {
    if (instant.used) used.push_back(&instant);
  }
  return used;
}

RigPath MakeRigPath(const TrajectorySpec& spec, double nearest, double farthest, int seed) {
  RigPath path;
  switch (spec.shape) {
    case TrajectorySpec::Shape::kHandheld:
      path = HandheldPath(spec, nearest, farthest, seed);
      break;
    case TrajectorySpec::Shape::kGiven:
      path = GivenPath(spec.given);
      MarkSegments(spec, &path);
      break;
    case TrajectorySpec::Shape::kLoop:
      path = LoopPath(spec, seed);
      MarkSegments(spec, &path);
  }
  FindVelocities(&path.instants);
  return path;
}

}  // namespace plenocal::simulate
