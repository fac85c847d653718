// SPDX-License-Identifier: Apache-2.0
//
// Cameras of one rig whose clocks differ: their images of one frame were not taken at one time, and
// the rig moved in between.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/start/camera_guess.h"

namespace plenocal {

/// Times at which the images of a rig were taken, by the clock of each camera.
struct RigTimes {
  std::vector<double> frame;  ///< per frame: of its first camera with an image, s
  /// Per view (`Bundle::View`): that of its image less that of the frame, s; 0 without an image.
  std::vector<double> after_frame;
  double interval = 0;  ///< median between frames that follow each other, s
};

/// Times of the frames of these names; nothing for one camera, fewer than five frames, and where an
/// image has none.
std::optional<RigTimes> TimesOf(std::span<const CameraInput> cameras,
                                const std::vector<std::string>& frames);

/// True when the frames follow each other closely enough that the rig's motion between them is
/// known: the target's position in a frame as its neighbours predict it is off by less than a third
/// of the displacement from frame to frame, in the median.
bool ShowsMotion(const Bundle& bundle, const RigTimes& times);

/// Gives each camera but the first a time shift to be estimated, with a Gaussian prior as wide as
/// the interval, and each view the motion at its time (`UpdateMotion`).
void AddTimeShifts(const RigTimes& times, Bundle* bundle);

/// Sets `Bundle::motion` from the poses and time shifts as they are: the increment from a frame's
/// pose to that at a view's time, by polynomials through the poses of five to 13 frames, whichever
/// predict best.
void UpdateMotion(const RigTimes& times, Bundle* bundle);

}  // namespace plenocal
