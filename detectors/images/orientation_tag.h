// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "detectors/images/bytes.h"

namespace plenocal::internal {

/// The orientation tag (EXIF, 1 to 8) in the content of a JPEG file. 1, as recorded, where there is
/// none that can be read, and of other formats.
int OrientationTag(ByteView file);

}  // namespace plenocal::internal
