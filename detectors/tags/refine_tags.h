// SPDX-License-Identifier: Apache-2.0
//
// Measurement of the corners of detected tags by fits of their templates.
#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <span>
#include <vector>

#include "detectors/images/distortion_field.h"
#include "detectors/tags/seen_tag.h"

namespace plenocal::internal {

struct RefinedCorner {
  Eigen::Vector2d point;              ///< px
  double sigma = 0;                   ///< px, of each coordinate
  DistortionSensitivity sensitivity;  ///< to the distortion assumed
};

using RefinedQuad = std::array<std::optional<RefinedCorner>, 4>;

struct RefinedTags {
  std::vector<RefinedQuad> quads;
  std::vector<DistortionMeasurement> measurements;  ///< of the lens distortion by the image
};

/// Corners of tags, from fits of their templates: of the whole tag, or of the quarter around each
/// corner where the distortion within the tag needs more than its local description. The distortion
/// is estimated from all tags of the image together. Corners of a tag that cannot be fitted are
/// missing.
RefinedTags RefineTags(const cv::Mat& gray, std::span<const SeenTag> tags, const TagBorder& border);

/// Looks for a tag that should be within `reach` (px) of `expected`; nothing when the image does
/// not show its bits there.
std::optional<Quad> FindTag(const cv::Mat& gray,
                            const SeenTag& expected,
                            const TagBorder& border,
                            double reach);

}  // namespace plenocal::internal
