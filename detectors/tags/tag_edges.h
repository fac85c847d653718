// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <span>
#include <vector>

#include "detectors/lens_curvature.h"

namespace plenocal::internal {

/// A tag's corners in the image: lower left, lower right, upper right, upper left of the upright
/// tag.
using Quad = std::array<Eigen::Vector2d, 4>;

/// A tag as it was seen and read.
struct SeenTag {
  Quad corners;  ///< px, good to a fraction of a bit
  /// Bits within the outline, row by row from the upright tag's upper left corner: true where the
  /// colour is not that of the ring just inside the outline.
  std::vector<bool> bits;
};

/// What all tags of a target have along their outline.
struct TagBorder {
  int width = 0;                ///< bits between the left and the right edge
  int ring = 1;                 ///< bits, width of the ring of one colour inside the outline
  double outside = 1;           ///< bits, width of the other colour's ring outside it
  int outside_sign = 1;         ///< 1 if that is white, -1 if black
  bool corner_squares = false;  ///< squares of the inner ring's colour touch the corners
};

struct RefinedCorner {
  Eigen::Vector2d point;  ///< px
  double sigma = 0;       ///< px, of each coordinate
  BentMarker bent;        ///< what the point owes to the lens assumed
};

using RefinedQuad = std::array<std::optional<RefinedCorner>, 4>;

struct RefinedTags {
  std::vector<RefinedQuad> quads;
  std::vector<LensReading> readings;  ///< what the image says about the lens
};

/// Corners of tags, from their whole drawing where they are small and else from curves fitted to
/// their outer edges. An edge is a blurred step from black to white across a parabola; a parabola,
/// because lens distortion bends it. How much the lens bends edges is learned from all tags of the
/// image together. A corner is missing when one of its two edges cannot be measured (out of the
/// image, covered, no contrast).
RefinedTags RefineTags(const cv::Mat& gray, std::span<const SeenTag> tags, const TagBorder& border);

/// Looks for a tag that should be within `reach` (px) of `expected`; nothing when the image does
/// not show its bits there.
std::optional<Quad> FindTag(const cv::Mat& gray,
                            const SeenTag& expected,
                            const TagBorder& border,
                            double reach);

}  // namespace plenocal::internal
