// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "calib/micro_lens_array.h"

namespace plenocal {

/// The micro-lens array that RxLive's calibration file describes (XML, root `RayCalibData`), for an
/// image of this size.
///
/// `offset` (px, y up) places a micro lens of type 0 relative to the middle of the image;
/// `lens_base_x`, `lens_base_y` (in micro-lens diameters, y up) span the lattice, possibly negated.
/// `rotation` is the angle of the array: the bases carry its coarse part only in some files, so
/// what they lack of it, modulo the 60 degrees of a hexagon, is added. The distortion of the main
/// lens is not applied: the file does not say in what unit its radius is.
///
/// Throws `Error` of kind kInput with file and element.
MicroLensArray ReadRayCalibData(const std::filesystem::path& path, ImageSize image_size);

/// What a user should know that is in such a file and is not used: lens distortion. Empty when
/// there is none. Throws as above.
std::string UnusedRayCalibData(const std::filesystem::path& path);

}  // namespace plenocal
