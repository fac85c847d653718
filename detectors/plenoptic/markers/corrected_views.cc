// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/corrected_views.h"

#include <utility>

#include "detectors/plenoptic/markers/depth_correction.h"
#include "detectors/plenoptic/markers/vignetting_correction.h"

namespace plenocal {

std::vector<View> CorrectedViews(const std::vector<std::string>& frames,
                                 int lens_types,
                                 std::vector<internal::RawMeasurements> images) {
  auto shared_errors = internal::CorrectVignettingDisplacement(lens_types, &images);
  internal::CorrectDepthBias(&images);
  std::vector<View> views;
  for (size_t i = 0; i < images.size(); ++i) {
    View view{.frame = frames[i], .observations = {}};
    for (const internal::MarkerMeasurement& m : images[i]) {
      view.observations.push_back(m.observation);
      view.observations.back().lens_type = m.lens_type;
    }
    view.shared_errors = std::move(shared_errors[i]);
    if (!view.observations.empty()) views.push_back(std::move(view));
  }
  return views;
}

}  // namespace plenocal
