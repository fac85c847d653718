// SPDX-License-Identifier: Apache-2.0
//
// Properties of images that explain bad calibrations: orientation, blur, saturation, micro images.
#pragma once

#include <map>
#include <string>

#include "calib/traits/lattice_shift.h"

namespace plenocal {

/// Properties of an image beside its markers.
struct ImageTraits {
  int orientation = 1;  ///< tag (EXIF) by which viewers turn the image; 1: not at all
  /// Standard deviation of the blur of the target's edges, px; 0: not measured.
  double blur = 0;
  double saturated = 0;       ///< part of the target's area that has the largest gray level
  LatticeShift lattice = {};  ///< of a raw plenoptic image
};

/// The images of one camera by frame; empty where they are not at hand.
using CameraTraits = std::map<std::string, ImageTraits>;

}  // namespace plenocal
