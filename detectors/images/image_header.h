// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "calib/camera/observation.h"

namespace plenocal {

/// Size of the image in pixels as the header of a PNG, JPEG, TIFF, BMP, PGM or PPM file states it.
/// `start` is the content of the file or its beginning. Nothing for any other content, and where
/// the header lies further back (TIFF, JPEG with long comments). The image itself may be damaged.
std::optional<ImageSize> SizeInHeader(std::span<const std::uint8_t> start);

}  // namespace plenocal
