// SPDX-License-Identifier: Apache-2.0
#include "calib/judge/causes/image_causes.h"

#include <fmt/format.h>

#include <algorithm>

namespace plenocal {
std::vector<Finding> FindOrientationTags(const std::string& camera, const CameraTraits& traits) {
  const auto count = std::ranges::count_if(
      traits, [](const auto& image) { return image.second.orientation != 1; });
  if (count == 0) return {};
  return {{.code = "orientation_tag",
           .grade = Grade::kGood,
           .cameras = {camera},
           .value = static_cast<double>(count),
           .limit = 1,
           .what = fmt::format("{}: {} an orientation tag (EXIF), by which viewers turn {}; pixels "
                               "are used as the sensor recorded them.",
                               camera,
                               count == 1 ? "one image has" : fmt::format("{} images have", count),
                               count == 1 ? "it" : "them"),
           .remedy = "Let other programs that use this calibration ignore the tag as well (OpenCV: "
                     "IMREAD_IGNORE_ORIENTATION)."}};
}

}  // namespace plenocal
