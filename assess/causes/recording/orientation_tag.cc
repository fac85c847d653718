// SPDX-License-Identifier: Apache-2.0
//
// Images with an orientation tag: a note, of grade good.
#include <fmt/format.h>

#include <algorithm>

#include "assess/causes/cause.h"

namespace plenocal {
namespace {

// Pixels are used as recorded, which other programs may not do.
std::vector<Finding> FindOrientationTags(const CauseEvidence& evidence) {
  const auto count = std::ranges::count_if(
      *evidence.traits, [](const auto& image) { return image.second.orientation != 1; });
  if (count == 0) return {};
  return {{.code = "orientation_tag",
           .grade = Grade::kGood,
           .value = static_cast<double>(count),
           .limit = 1,
           .what = fmt::format("{} an orientation tag (EXIF), by which viewers turn {}; pixels "
                               "are used as the sensor recorded them.",
                               count == 1 ? "one image has" : fmt::format("{} images have", count),
                               count == 1 ? "it" : "them"),
           .remedy = "Let other programs that use this calibration ignore the tag as well (OpenCV: "
                     "IMREAD_IGNORE_ORIENTATION)."}};
}

}  // namespace

Cause OrientationTagCause() { return {CauseStage::kImageFile, FindOrientationTags}; }

}  // namespace plenocal
