// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace plenocal {

/// The detections CSV of mrcal's corners.vnl: the corners of an image count from 0 in the order of
/// its lines, which is ours of a chessboard (rows of equal y one after another). `level` (each
/// halves the resolution) and `weight` become sigmas relative to 1 px at full resolution; corners
/// with "-" or a weight that is not positive are left out, as mrcal does.
///
/// Throws `Error` of kind kInput with file and line.
std::string DetectionsFromCornersVnl(const std::filesystem::path& path);

}  // namespace plenocal
