// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "detectors/tags/refine_tags.h"
#include "targets/target.h"

namespace plenocal::internal {

/// The border that all tags of a target share, and the bits of each.
struct TagPatterns {
  TagBorder border;
  std::map<int, std::vector<bool>> bits;  ///< by tag, as in `SeenTag`
};

/// As the image shows them, in which these tags were found. Throws `Error` for a family or tag that
/// does not exist.
TagPatterns FindTagPatterns(const TagLayout& layout,
                            const Target& target,
                            const cv::Mat& gray,
                            const std::map<int, Quad>& found);

}  // namespace plenocal::internal
