// SPDX-License-Identifier: Apache-2.0
//
// Views of a wall of known brightness by a small camera of known attenuation.
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>
#include <random>
#include <string>
#include <vector>

#include "apps/photometry/wall_views.h"
#include "models/registry.h"

namespace plenocal::testing::small_wall {

using Eigen::Vector3d;

inline constexpr double kPi = std::numbers::pi;
inline constexpr int kWidth = 160, kHeight = 28;
inline constexpr double kFocal = 110, kCentreX = 78, kCentreY = 14;
inline constexpr double kElectrons = 10000;

inline double TrueAttenuation(double x, double y) {
  const double u = (x - 70) / 80, v = (y - 16) / 80;
  return 1 / std::pow(1 + 0.5 * (u * u + v * v), 2);
}
inline double Brightness(const Vector3d& p) {
  return std::exp(0.25 * std::sin(9 * p.x() + 1) * std::cos(7 * p.y()) +
                  0.15 * std::sin(23 * p.x() - 17 * p.y()) - 0.1 * p.x());
}

struct SmallWall {
  CalibratedCamera camera;
  WallRecording recording;
  std::vector<double> errors;  // ln(true / recorded exposure)
};

struct WallChanges {
  int views = 18;
  double noise = 1;    // of 10,000 electrons
  double shading = 0;  // of light that goes with the camera but does not turn: 1 + shading * x^2, m
  int misplaced = -1;
};

inline SmallWall MakeSmallWall(const WallChanges& changes = {}) {
  std::mt19937_64 engine(3);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(-1, 1);
  SmallWall wall;
  wall.camera.model = FindModel(CameraModels(), "pinhole-radial3");
  wall.camera.image_size = {kWidth, kHeight};
  wall.camera.params = {kFocal, kFocal, kCentreX, kCentreY, 0, 0, 0};
  for (int i = 0; i < changes.views; ++i) {
    // Every second one is turned by 90 degrees.
    const double roll = (i % 2 == 0 ? 0 : kPi / 2) + 0.1 * uniform(engine);
    RigidTransform T;
    T.R = (Eigen::AngleAxisd(roll, Vector3d::UnitZ()) *
           Eigen::AngleAxisd(0.35 * uniform(engine), Vector3d::UnitX()) *
           Eigen::AngleAxisd(0.35 * uniform(engine), Vector3d::UnitY()))
              .toRotationMatrix() *
          Vector3d(1, -1, -1).asDiagonal();
    T.t = Vector3d(0.15 * uniform(engine), 0.1 * uniform(engine), 0.8 + 0.15 * uniform(engine));
    const RigidTransform back = T.Inverse();
    const double exposure = 3 + uniform(engine), error = 0.02 * normal(engine);
    wall.errors.push_back(error);
    WallView view{.frame = std::to_string(i),
                  .exposure = exposure,
                  .T_camera_wall = T,
                  .brightness = {},
                  .light = {}};
    view.light.create(kHeight, kWidth, CV_32F);
    view.brightness.create(kHeight, kWidth, CV_32F);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const Vector3d ray = back.R * Vector3d((x - kCentreX) / kFocal, (y - kCentreY) / kFocal, 1);
        const Vector3d p = back.t - back.t.z() / ray.z() * ray;
        double light = 30 * Brightness(p) * TrueAttenuation(x, y) * exposure * std::exp(error) *
                       (1 + changes.shading * std::pow(p.x() - back.t.x(), 2));
        light += changes.noise * normal(engine) * std::sqrt(light * 255 / kElectrons);
        view.light.at<float>(y, x) = static_cast<float>(light);
        view.brightness.at<float>(y, x) = static_cast<float>(std::log(light / exposure));
      }
    }
    if (i == changes.misplaced) view.T_camera_wall.t.x() += 0.06;
    wall.recording.views.push_back(view);
  }
  wall.recording.marker = {-0.05, -0.04, 0.05, 0.04};
  return wall;
}

inline WallRecording Recorded(const SmallWall& wall) {
  WallRecording recording = wall.recording;
  recording.camera = &wall.camera;
  return recording;
}

}  // namespace plenocal::testing::small_wall
