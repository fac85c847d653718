// SPDX-License-Identifier: Apache-2.0
#include "engine/suggest/suggested_views.h"

#include <map>
#include <utility>

namespace plenocal {

std::vector<View> ViewsOf(const CalibrationRecord& calibration, const CalibratedCamera& camera) {
  std::map<int, View> views;
  for (const ResidualRow& row : camera.residuals) {
    View& view = views[row.frame];
    view.frame = calibration.frames[static_cast<size_t>(row.frame)].name;
    view.observations.push_back(
        {.marker = row.marker, .values = row.values, .detector_sigma = row.noise_sigma});
  }
  std::vector<View> list;
  for (auto& [frame, view] : views) list.push_back(std::move(view));
  return list;
}

}  // namespace plenocal
