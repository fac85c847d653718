// SPDX-License-Identifier: Apache-2.0
//
// Closed-form initial guesses of focused plenoptic cameras.
#pragma once

#include <span>
#include <vector>

#include "calib/camera/camera_model.h"

namespace plenocal {

/// Closed-form initial guess [f_L, b_L0, B, c_x, c_y, A_0, A_1, B_0, B_1] of a focused plenoptic
/// camera (docs/plenoptic.md). All micro images of one marker in one frame obey
/// x_R = u_0 + s c_I. With T = 1 / (1 - s), the point q = u_0 T is the image of an ordinary pinhole
/// camera of focal length b_L0 + B, and T = a + b / z:
///
///   B = (b_L0 + B)^2 / (b + b_L0 + B),  f_L = b_L0 / (1 - a B / (b_L0 + B)).
///
/// `pinhole` is the model `pinhole-radial3`; config[0] is the pixel size, m; observations are (x,
/// y, lens_x, lens_y). A second candidate takes f_L from the user, for targets without depth. Empty
/// when the views do not suffice.
std::vector<StartCandidate> StartPlenoptic(const CameraModel& pinhole, const StartProblem& problem);

/// Likewise with the exit pupil's distance b_P as tenth parameter, for a given f_L. The virtual
/// image's pinhole then is in the entrance pupil and has another focal length F; with
/// e = f_L - b_L0 and distances from the entrance pupil
///
///   F = f_L (b_P + B) / (e + b_P),  a = e F / (f_L B),  b = f_L b_P F / ((e + b_P) B).
std::vector<StartCandidate> StartPlenopticPupil(const CameraModel& pinhole,
                                                const StartProblem& problem);

/// Likewise with w_P = 1/b_P as tenth parameter: given, or that of a pupil in the thin lens.
std::vector<StartCandidate> StartPlenopticThick(const CameraModel& pinhole,
                                                const StartProblem& problem);

/// The virtual image of each view, in which the camera is an ordinary one of focal length b_L0 + B:
/// one observation (x, y) for each marker that at least two micro images show, px.
std::vector<View> VirtualImageViews(std::span<const View> views);

}  // namespace plenocal
