// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/recording.h"

#include <algorithm>

#include "detectors/images/image.h"

namespace plenocal {

cv::Mat RecordedCamera::Read(size_t index) const { return ReadRawGray(images[index]); }

bool Recording::HasTimes() const {
  return std::ranges::all_of(
      cameras, [](const RecordedCamera& camera) { return camera.images.front().time.has_value(); });
}

const RecordedCamera* Recording::FindCamera(const std::string& name) const {
  const auto found = std::ranges::find(cameras, name, &RecordedCamera::name);
  return found == cameras.end() ? nullptr : &*found;
}

}  // namespace plenocal
