// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/targets/hand_path.h"

#include <cmath>
#include <numbers>

#include "apps/simulate/spec/random.h"

namespace plenocal::simulate {
namespace {

constexpr size_t kSines = 4;

}  // namespace

HandPath::HandPath(const PoseSpec& poses, int seed) : poses_(poses) {
  constexpr size_t kSignals = 6;                    // two of the position, the tilt; distance, roll
  constexpr double kSlowest = 0.1, kFastest = 0.8;  // Hz
  for (size_t s = 0; s < kSignals; ++s) {
    Random random(seed, "hand", {s});
    Signal& signal = signals_.emplace_back();
    double sum = 0;
    for (size_t i = 0; i < kSines; ++i) {
      const double frequency = random.Uniform(kSlowest, kFastest);
      // Equal velocities: fast motions are small.
      signal.push_back({.amplitude = 1 / frequency,
                        .frequency = 2 * std::numbers::pi * frequency,
                        .phase = random.Uniform(0, 2 * std::numbers::pi)});
      sum += signal.back().amplitude;
    }
    for (Sine& sine : signal) sine.amplitude /= sum;
  }
}

double HandPath::ValueAt(const Signal& signal, double time) {
  double value = 0;
  for (const Sine& sine : signal) {
    value += sine.amplitude * std::sin(sine.frequency * time + sine.phase);
  }
  return value;
}

Placement HandPath::At(double time) const {
  constexpr double kReach = 0.35;  // from the middle, in parts of the image
  const auto value = [&](size_t signal) { return ValueAt(signals_[signal], time); };
  Placement placement;
  placement.share = Eigen::Vector2d(0.5 + kReach * value(0), 0.5 + kReach * value(1));
  // Uniform in 1 / distance, which is the effect of depth on an image.
  const double near = 1 / poses_.nearest, far = 1 / poses_.farthest;
  placement.distance = 2 / (near + far + (near - far) * value(2));
  if (poses_.one_distance) placement.distance = (poses_.nearest + poses_.farthest) / 2;
  const double across = value(3), along = value(4);
  placement.tilt = poses_.no_tilt ? 0 : poses_.tilt * std::hypot(across, along);
  placement.azimuth = std::atan2(along, across);
  placement.roll = poses_.roll * value(5);
  return placement;
}

}  // namespace plenocal::simulate
