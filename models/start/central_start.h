// SPDX-License-Identifier: Apache-2.0
//
// Initial guesses of ordinary cameras without help from the user.
#pragma once

#include <functional>
#include <vector>

#include "calib/camera/camera_model.h"

namespace plenocal {

/// Parameters of cameras that image directions near the optical axis like a plain lens of focal
/// length f and principal point (c_x, c_y), px.
using CamerasNearAxis =
    std::function<std::vector<std::vector<double>>(double f, double c_x, double c_y)>;

/// Initial guesses of a central model without help from the user.
///
/// 1. Radial alignment (Tsai 1987): whatever the focal length and radial distortion, an image point
///    lies on the ray from the image centre through its undistorted position. That gives each
///    view's pose linearly, but for the distance t_z, for planar and for spatial targets.
/// 2. All views together give the radial profile F(rho) = a_0 + a_2 rho^2 + a_4 rho^4 and the t_z
///    linearly, where (u, v, F(rho)) is the viewing direction of the image point (u, v)
///    (Scaramuzza et al., IROS 2006). Sets that do not determine F (distant, untilted targets) get
///    the best of a ladder of plain focal lengths besides.
/// 3. The model's own parameters are fitted to these directions, starting from each of `near_axis`,
///    its parameters for plain lenses of focal length f and principal point c.
///
/// Values in `problem.given` are kept.
std::vector<StartCandidate> StartCentral(const CameraModel& model,
                                         const StartProblem& problem,
                                         const CamerasNearAxis& near_axis);

/// Likewise of a model with lens coordinates, u = (f_x m_x + c_x, f_y m_y + c_y). `lenses`: the
/// parameters after c_y of plain lenses.
std::vector<StartCandidate> StartLens(const CameraModel& model,
                                      const StartProblem& problem,
                                      const std::vector<std::vector<double>>& lenses);

}  // namespace plenocal
