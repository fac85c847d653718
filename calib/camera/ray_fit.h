// SPDX-License-Identifier: Apache-2.0
//
// A fit of a central camera model to rays with known image points.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "calib/camera/camera_model.h"

namespace plenocal {

struct RayFitOptions {
  std::vector<int> fixed = {};  ///< indices of parameters that keep their value
  bool within_bounds = false;   ///< no step leaves the parameters' bounds
  int max_iterations = 50;
  double tolerance = 1e-6;  ///< of the sum of squares, relative
};

/// Fits a central model's parameters so that it images `directions[i]` at `image[i]`, px: least
/// squares of the distances in the image. Directions that the model does not image at the start do
/// not count. Returns false and leaves `params` alone when fewer directions than parameters remain
/// or the fit fails.
bool FitToRays(const CameraModel& model,
               std::span<const double> config,
               const std::vector<Eigen::Vector3d>& directions,
               const std::vector<Eigen::Vector2d>& image,
               const RayFitOptions& options,
               std::vector<double>* params);

}  // namespace plenocal
