// SPDX-License-Identifier: Apache-2.0
//
// The frames of a recording, which its cameras' images make by name or by time.
#pragma once

#include "engine/recording/recording.h"

namespace plenocal {

/// Makes the frames of `recording` from its cameras' images.
///
/// By name: images of equal names are one frame. By time: each camera is paired with the frames so
/// far, an image with the frame that is nearest to it if it is that frame's nearest too and not
/// farther than the tolerance. What finds no partner is a frame of its own.
///
/// Throws `Error` of kind kInput where times are missing that `pairing` needs, and for cameras that
/// share no name.
void MakeFrames(const Pairing& pairing, Recording* recording);

}  // namespace plenocal
