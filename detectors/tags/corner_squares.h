// SPDX-License-Identifier: Apache-2.0
//
// Recognition of black squares at the corners of tags.
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <span>

#include "detectors/tags/seen_tag.h"

namespace plenocal::internal {

/// Whether an image shows black squares at the tags' corners, as Kalibr prints them. Boards with a
/// border of any width have them or not, and the target file does not state it. Nothing where less
/// than three quarters of the corners agree, or fewer than four can be looked at.
std::optional<bool> ShowsCornerSquares(const cv::Mat& gray,
                                       std::span<const SeenTag> tags,
                                       const TagBorder& border);

}  // namespace plenocal::internal
