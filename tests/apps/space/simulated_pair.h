// SPDX-License-Identifier: Apache-2.0
//
// A simulated pair of pinhole cameras before an AprilGrid, for tests of points in space.
#pragma once

#include <fmt/format.h>

#include <string>

namespace plenocal::testing {

constexpr double kTagSize = 0.055, kTagPitch = 1.3 * kTagSize;  // m

inline const std::string kBoard = fmt::format(
    "plenocal: 1\ntype: aprilgrid\ncolumns: 6\nrows: 6\nsize: {}\nspacing: 0.3\n", kTagSize);

/// A specification of `simulate`, with `kBoard` in board.yaml. `poses`: keys of its poses.
inline std::string PairSpec(int seed, const std::string& poses) {
  return fmt::format(
      "plenocal: 1\nseed: {}\ntarget: board.yaml\n"
      "poses: {{kind: varied, {}}}\n"
      "cameras:\n"
      "  left: {{model: pinhole, image_size: [1280, 960], detection_sigma: 0.1,\n"
      "    parameters: {{f_x: 900, f_y: 901, c_x: 636, c_y: 483}}}}\n"
      "  right: {{model: pinhole, image_size: [1280, 960], detection_sigma: 0.1,\n"
      "    parameters: {{f_x: 905, f_y: 904, c_x: 641, c_y: 475}},\n"
      "    xi_camera_rig: [-0.12, 0.001, 0.002, 0.01, -0.02, 0.01]}}\n",
      seed,
      poses);
}

}  // namespace plenocal::testing
