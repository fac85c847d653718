// SPDX-License-Identifier: Apache-2.0
//
// Pairs the images of a recording's cameras to frames, by name or by time.
#pragma once

#include "engine/recording/recording.h"

namespace plenocal {

/// Makes the frames of `recording` from its cameras' images.
///
/// By name: images of equal names are one frame. By time: the cameras are added one after the other
/// to the frames so far. An image is added to the frame with the nearest time if no other image of
/// its camera is nearer to that frame and the difference is within the tolerance, else it becomes a
/// frame of its own.
///
/// Throws `Error` of kind kInput if times are missing that `pairing` needs, and if cameras have no
/// name in common.
void MakeFrames(const Pairing& pairing, Recording* recording);

}  // namespace plenocal
