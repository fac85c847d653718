// SPDX-License-Identifier: Apache-2.0
#include "detectors/boards/markers_detector.h"

#include "calib/base/format_error.h"

namespace plenocal {

void FailWithoutDetector(std::string_view type) {
  throw InputError(
      "a target of type {} has no detector; give the camera 'detections: "
      "file.csv' instead of 'images'",
      type);
}

std::unique_ptr<MarkerDetector> MakeDetector(const MarkersLayout& /*layout*/,
                                             const Target& /*target*/) {
  FailWithoutDetector("markers");
}

std::vector<internal::MarkerTemplate> internal::MakeTemplates(
    const MarkersLayout& /*layout*/,
    const Target& /*target*/,
    const std::vector<Observation>& /*found*/) {
  FailWithoutDetector("markers");
}

}  // namespace plenocal
