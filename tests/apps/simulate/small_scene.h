// SPDX-License-Identifier: Apache-2.0
//
// Specifications of small simulations, as a program makes them.
#pragma once

#include <string>
#include <vector>

#include "apps/simulate/spec/simulation_spec.h"
#include "models/registry.h"
#include "tests/digest.h"

namespace plenocal::simulate {

inline CameraSpec SmallCamera(const std::string& name, const RigidTransform& T_camera_rig = {}) {
  CameraSpec camera;
  camera.name = name;
  camera.model = FindModel(CameraModels(), "pinhole-radial3");
  camera.image_size = {64, 48};
  camera.params = {50, 51, 31, 24, -0.05, 0.01, 0};
  camera.T_camera_rig = T_camera_rig;
  camera.detection_sigma = 0;
  return camera;
}

/// A pair before a scene.
inline SimulationSpec SmallScene() {
  SimulationSpec spec;
  spec.path = "spec.yaml";
  spec.seed = 5;
  spec.cameras = {SmallCamera("left"),
                  SmallCamera("right", {ExpRotation({0.01, -0.05, 0.02}), {-0.2, 0.01, 0.02}})};
  spec.scenery.emplace();
  return spec;
}

using testing::Digest;

}  // namespace plenocal::simulate
