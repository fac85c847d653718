// SPDX-License-Identifier: Apache-2.0
//
// Two parallel pinhole cameras side by side, and what they see.
#pragma once

#include <string>
#include <vector>

#include "engine/rigs/triangulate_points.h"
#include "models/registry.h"

namespace plenocal::testing {

constexpr double kPairFocal = 800, kPairBase = 0.2, kPairNoise = 0.1;  // px, m, px

/// `sigma`: standard error of all numbers, px, m and rad; 0: the calibration states none.
inline CalibrationRecord ParallelCameras(double sigma = 1e-9, size_t count = 2) {
  CalibrationRecord record;
  for (size_t c = 0; c < count; ++c) {
    CalibratedCamera& camera = record.cameras.emplace_back();
    camera.name = std::vector<std::string>{"left", "right", "third"}[c];
    camera.model = FindModel(CameraModels(), "pinhole");
    camera.image_size = {640, 480};
    camera.params = {kPairFocal, kPairFocal, 320, 240};
    camera.covariance = sigma * sigma * Eigen::MatrixXd::Identity(4, 4);
    camera.fit.noise_sigma = kPairNoise;
    if (c == 0) continue;
    camera.T_camera_rig.t.x() = -kPairBase * static_cast<double>(c);
    camera.sigma_xi.setConstant(sigma);
  }
  return record;
}

/// The places of points 0, 1, ... in the images of one frame.
inline std::vector<SeenPoints> SeenByPair(const CalibrationRecord& record,
                                          const std::vector<Eigen::Vector3d>& points,
                                          const std::string& frame = "f1") {
  std::vector<SeenPoints> seen;
  for (const CalibratedCamera& camera : record.cameras) {
    View view{.frame = frame, .observations = {}};
    for (size_t k = 0; k < points.size(); ++k) {
      const Eigen::Vector3d p = camera.T_camera_rig * points[k];
      Observation& each = view.observations.emplace_back();
      each.marker = static_cast<int>(k);
      each.values[0] = camera.params[2] + camera.params[0] * p.x() / p.z();
      each.values[1] = camera.params[3] + camera.params[1] * p.y() / p.z();
    }
    seen.push_back({.camera = camera.name, .source = camera.name + ".csv", .views = {view}});
  }
  return seen;
}

}  // namespace plenocal::testing
