// SPDX-License-Identifier: Apache-2.0
//
// The reader and the writer of Raytrix' files of a micro-lens grid.
#pragma once

#include <filesystem>
#include <string>

#include "calib/camera/micro_lens_array.h"

namespace plenocal {

/// Reads the micro-lens array of a calibration file of Raytrix' RxLive (XML, root `RayCalibData`),
/// for an image of this size.
///
/// `offset` (px, y up) places a micro lens of type 0 relative to the middle of the image;
/// `lens_base_x`, `lens_base_y` (in micro-lens diameters, y up) span the lattice, possibly negated.
/// `rotation` is the angle of the array. In some files the bases include a coarse part of it, so
/// only the remainder, modulo the 60 degrees of a hexagon, is added. The distortion of the main
/// lens is not applied, since the unit of its radius is not documented.
///
/// Throws `Error` of kind kInput with file and element.
MicroLensArray ReadRayCalibData(const std::filesystem::path& path, ImageSize image_size);

/// The text of such a file: the regular lattice that fits the centres best, and the lens types.
/// Values that RxLive derives from it but the centres do not show (depth ranges, distortion) are
/// neutral.
/// Throws `Error` of kind kInput for a rectangular lattice, which the format cannot hold.
std::string RayCalibDataXml(const MicroLensArray& array);

/// A note for the user about data of such a file that are not used (lens distortion). Empty when
/// there are none. Throws as above.
std::string UnusedRayCalibData(const std::filesystem::path& path);

}  // namespace plenocal
