// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <span>

#include "detectors/tags/refine_tags.h"

namespace plenocal::internal {

/// Whether an image shows black squares at the tags' corners, as Kalibr prints them; boards with
/// any width of the border have them or not, whatever their target file says. Nothing where the
/// corners disagree, as in front of other things, or are too few or too small to tell.
std::optional<bool> ShowsCornerSquares(const cv::Mat& gray,
                                       std::span<const SeenTag> tags,
                                       const TagBorder& border);

}  // namespace plenocal::internal
