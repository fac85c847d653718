// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <span>
#include <vector>

#include "detectors/images/distortion_field.h"
#include "targets/tags/quad.h"

namespace plenocal::internal {

/// A tag as detected and decoded.
struct SeenTag {
  Quad corners;  ///< px, good to a fraction of a bit
  /// Bits within the outline, row by row from the upright tag's upper left corner: true where the
  /// colour is not that of the ring just inside the outline.
  std::vector<bool> bits;
};

/// The surroundings of the outline, common to all tags of a target.
struct TagBorder {
  int width = 0;                ///< bits between the left and the right edge
  int ring = 1;                 ///< bits, width of the ring of one colour inside the outline
  double outside = 1;           ///< bits, width of the other colour's ring outside it
  int outside_sign = 1;         ///< 1 if that is white, -1 if black
  bool corner_squares = false;  ///< squares of the inner ring's colour touch the corners
};

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
