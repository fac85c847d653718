// SPDX-License-Identifier: Apache-2.0
//
// Specifications of small simulations, as a program makes them.
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "apps/simulate/spec/simulation_spec.h"
#include "models/registry.h"

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

/// A number that changes with any of the values and with their order.
class Digest {
 public:
  void Add(double value) { sum_ += value * std::cos(0.7 * ++count_); }
  template <typename Values>
  void AddAll(const Values& values) {
    for (const double value : values) Add(value);
  }
  void Add(const RigidTransform& T) {
    AddAll(T.t);
    AddAll(T.R.reshaped());
  }
  [[nodiscard]] double Sum() const { return sum_; }

 private:
  double sum_ = 0;
  int count_ = 0;
};

}  // namespace plenocal::simulate
