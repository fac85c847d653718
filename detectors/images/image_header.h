// SPDX-License-Identifier: Apache-2.0
//
// What image files state before their pixels.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "calib/camera/observation.h"

namespace plenocal {

/// Images with more pixels are refused before memory is allocated for them: the largest sensors of
/// cameras have 247 megapixels.
inline constexpr std::uint64_t kMostPixels = std::uint64_t{1} << 28;

/// "4 x 3 pixels", or of more than `kMostPixels` this and the limit.
std::string PixelsText(std::uint64_t width, std::uint64_t height);

/// Size of the image in pixels as the header of a file of the formats in codecs/ states it.
/// `start` is the content of the file or its beginning. Nothing for any other content, and where
/// the header lies further back (TIFF, JPEG with long comments). The image itself may be damaged.
std::optional<ImageSize> SizeInHeader(std::span<const std::uint8_t> start);

/// True for the beginning of a file that may have its size further back.
bool HasSizeFurtherBack(std::span<const std::uint8_t> start);

/// The orientation tag (EXIF, 1 to 8) of a JPEG file's content. 1, as recorded, where there is none
/// that can be read, and of other formats.
int OrientationInHeader(std::span<const std::uint8_t> file);

}  // namespace plenocal
