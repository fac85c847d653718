// SPDX-License-Identifier: Apache-2.0
//
// Smooth motion of a hand-held rig before a target.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "apps/simulate/spec/simulation_spec.h"

namespace plenocal::simulate {

/// Position of the target in the image and orientation before the camera.
struct Placement {
  Eigen::Vector2d share{0.5, 0.5};         ///< position in the image, in parts of its size
  double distance = 0;                     ///< m
  double tilt = 0, azimuth = 0, roll = 0;  ///< rad; azimuth is that of the axis of the tilt
};

/// A way on which a hand moves the rig (or the target) smoothly through the range of a
/// specification: each coordinate is a sum of sines of 0.1 to 0.8 Hz.
class HandPath {
 public:
  HandPath(const PoseSpec& poses, int seed);
  [[nodiscard]] Placement At(double time) const;

 private:
  struct Sine {
    double amplitude = 0, frequency = 0, phase = 0;  ///< rad/s, rad
  };
  // In [-1, 1].
  using Signal = std::vector<Sine>;
  static double ValueAt(const Signal& signal, double time);

  PoseSpec poses_;
  std::vector<Signal> signals_;
};

}  // namespace plenocal::simulate
