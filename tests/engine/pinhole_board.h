// SPDX-License-Identifier: Apache-2.0
//
// Points of a simulated camera for the tests of the engine.
#pragma once

#include <string>

#include "calib/camera/rigid_transform.h"
#include "engine/session/memory_session.h"
#include "models/registry.h"
#include "targets/target.h"
#include "tests/calib/random.h"

namespace plenocal::testing {

inline constexpr const char* kBoard = "chessboard:7x5:40mm";
inline constexpr double kFocal = 600;  // px

/// A pinhole camera of 640 x 480 px before a board, as points with noise of 0.1 px.
inline MemoryCamera PinholeBeforeBoard(unsigned seed, double focal = kFocal) {
  Random random(seed);
  MemoryCamera camera{
      .name = "left", .model = FindModel(CameraModels(), "pinhole"), .image_size = {640, 480}};
  const Target board = TargetOfWord(kBoard);
  for (int frame = 0; frame < 10; ++frame) {
    const Eigen::Vector3d w(
        random.Uniform(-0.5, 0.5), random.Uniform(-0.5, 0.5), random.Uniform(-0.3, 0.3));
    const RigidTransform T_camera_target{ExpRotation(w), {-0.12, -0.08, random.Uniform(0.4, 0.6)}};
    View view{.frame = std::to_string(frame), .observations = {}};
    for (const auto& [marker, position] : board.markers) {
      const Eigen::Vector3d p = T_camera_target * position;
      Observation& seen = view.observations.emplace_back();
      seen.marker = marker;
      seen.values[0] = 320 + focal * p.x() / p.z() + random.Gaussian(0.1);
      seen.values[1] = 240 + focal * p.y() / p.z() + random.Gaussian(0.1);
      seen.detector_sigma = 0.1;
    }
    camera.views.push_back(std::move(view));
  }
  return camera;
}

}  // namespace plenocal::testing
