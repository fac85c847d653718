// SPDX-License-Identifier: Apache-2.0
//
// The calibration problem of a session and its observations.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "calib/base/run.h"
#include "calib/estimate/calibrate.h"
#include "calib/files/session.h"
#include "targets/target.h"

namespace plenocal {

/// Gives a camera the model and what else the session states of it; size and views stay.
void UseSessionCamera(const SessionCamera& camera, CameraInput* input);
/// A camera of a session, without views.
CameraInput InputWithoutViews(const SessionCamera& camera);

/// Throws `Error` of kind kInput where the session states another size of the camera's images.
void CheckImageSize(const SessionCamera& camera, ImageSize found);

/// Number of points in all views.
size_t CountObservations(std::span<const View> views);

/// The freedom of a refined target's markers: its tolerance, or 1 % of the markers' spacing, that
/// of a laser printer and a hard board.
MarkerFreedom RefinedMarkerFreedom(const Target& target);

/// The calibration problem of a session and its observations. Prints whether and how the target's
/// markers are refined where session and target leave it open.
CalibrationInput MakeCalibrationInput(const Session& session,
                                      const Target& target,
                                      std::vector<CameraInput> cameras,
                                      const Run& run);

}  // namespace plenocal
