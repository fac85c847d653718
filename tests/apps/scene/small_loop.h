// SPDX-License-Identifier: Apache-2.0
//
// A simulated loop that is small enough for a test of a second.
#pragma once

#include <fmt/format.h>

#include <string>

namespace plenocal::testing {

struct SmallLoop {
  int points = 150, frames = 12;
  double wrong_matches = 0, moving = 0;
  std::string trajectory = "kind: loop";  ///< further keys
};

/// Specification of a stereo pair on a loop of 100 m.
inline std::string SmallLoopYaml(const SmallLoop& loop) {
  const std::string camera =
      "    model: pinhole-radial3\n"
      "    image_size: [1280, 1024]\n"
      "    parameters: {f_x: 755, f_y: 755, c_x: 640, c_y: 512, A_0: -0.2, A_1: 0.06, A_2: -0.01}\n"
      "    detection_sigma: 0.3\n";
  return fmt::format(
      "plenocal: 1\nseed: 3\n"
      "scene: {{points: {}, near: 2, far: 6, wrong_matches: {}, moving: {}}}\n"
      "trajectory: {{{}, frames: {}}}\n"
      "cameras:\n  left:\n{}  right:\n{}    xi_camera_rig: [-0.1, 0, 0, 0, 0, 0]\n",
      loop.points,
      loop.wrong_matches,
      loop.moving,
      loop.trajectory,
      loop.frames,
      camera,
      camera);
}

}  // namespace plenocal::testing
