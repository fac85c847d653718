// SPDX-License-Identifier: Apache-2.0
//
// A plenoptic camera whose scene points are virtual image points: (x, y) px of virtual depth z.
#pragma once

#include <cmath>
#include <optional>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/camera/micro_lens_array.h"
#include "models/registry.h"

namespace plenocal::testing {

/// Through a lens at c, p is seen at c + (p - c) / z + (a (c_x - x)^2, b (c_y - y)^2), where c_x is
/// below the third parameter; rays start at the first two values.
struct VirtualLenses {
  CameraModel model = *FindModel(CameraModels(), "pinhole");
  BundleCamera camera;
  std::vector<Eigen::Vector2d> centres;
  MicroLensArray array;

  VirtualLenses() {
    model.plenoptic = true;
    model.functions.project = Project;
    model.functions.project_with_jacobian = Differentiate;
    model.functions.unproject = RayOfValues;
    camera.name = "light";
    // Some centres lie beyond its border.
    camera.image_size = {285, 185};
    camera.model = &model;
    camera.params = {0, 0, 1000, 0};
    camera.fixed = {false, false, true, true};
    camera.is_master = true;
    for (int row = 0; row < 22; ++row) {
      for (int column = 0; column < 30; ++column) {
        centres.emplace_back(10 * column + (row % 2 == 0 ? 2.5 : 7.5), 9 * row + 4.1);
        array.lenses.push_back({.centre = centres.back()});
      }
    }
    array.image_size = camera.image_size;
    array.e_column = {10, 0}, array.e_row = {6, 8};
  }

 private:
  static bool Project(const CameraModel& /*model*/,
                      const double* params,
                      const double* /*config*/,
                      const double* values,
                      const Eigen::Vector3d& p,
                      double /*h*/,
                      double* predicted) {
    const Eigen::Vector2d c(values[2], values[3]);
    if (p.z() == 0 || c.x() > params[2]) return false;
    for (int i = 0; i < 2; ++i) {
      predicted[i] = c[i] + (p[i] - c[i]) / p.z() + params[i] * std::pow(c[i] - p[i], 2);
    }
    return true;
  }

  static bool Differentiate(const CameraModel& model,
                            const double* params,
                            const double* config,
                            const double* values,
                            const Eigen::Vector3d& p,
                            double h,
                            const ProjectionOutput& out) {
    if (!Project(model, params, config, values, p, h, out.predicted)) return false;
    for (int i = 0; i < 2; ++i) {
      const double away = values[2 + i] - p[i];
      for (int k = 0; k < 4 && out.J_params != nullptr; ++k) {
        out.J_params[4 * i + k] = k == i ? away * away : 0;
      }
      for (int k = 0; k < 2; ++k) {
        out.J_point[3 * i + k] = k == i ? 1 / p.z() - 2 * params[i] * away : 0;
      }
      out.J_point[3 * i + 2] = away / (p.z() * p.z());
    }
    return true;
  }

  static std::optional<Ray> RayOfValues(const CameraModel& /*model*/,
                                        const double* /*params*/,
                                        const double* /*config*/,
                                        const double* values) {
    return Ray{{values[0], values[1], 0}, Eigen::Vector3d(values[2], values[3], 100).normalized()};
  }
};

}  // namespace plenocal::testing
