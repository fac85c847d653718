// SPDX-License-Identifier: Apache-2.0
//
// Image files in memory, of the formats in codecs/.
#pragma once

#include <opencv2/core/mat.hpp>

#include "detectors/images/codecs/image_codec.h"

namespace plenocal {

/// The pixels of an image file's content. Throws `ImageDefect` for content that is no image or a
/// damaged one, and for more pixels or bytes than are read.
cv::Mat DecodeImage(internal::ByteView content, Channels channels);

}  // namespace plenocal
