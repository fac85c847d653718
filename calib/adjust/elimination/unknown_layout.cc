// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/elimination/unknown_layout.h"

namespace plenocal::internal {

UnknownLayout MakeLayout(const Bundle& bundle, const std::vector<bool>& has_data) {
  UnknownLayout layout;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const BundleCamera& camera = bundle.cameras[c];
    std::vector<int> indices;
    for (size_t k = 0; k < camera.params.size(); ++k) {
      const bool own = bundle.Root(c, k) == ParamIndex{c, k};
      const bool fixed = camera.fixed[k] || (!camera.at_bound.empty() && camera.at_bound[k]);
      indices.push_back(!own || fixed || !has_data[c] ? -1 : layout.head++);
    }
    layout.params.push_back(indices);
    const bool free = !camera.is_master && has_data[c];
    layout.extrinsics.push_back(free ? layout.head : -1);
    if (free) layout.head += 6;
  }
  for (const BundleTarget& target : bundle.targets) {
    layout.targets.push_back(target.is_fixed ? -1 : layout.head);
    if (!target.is_fixed) layout.head += 6;
  }
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    for (size_t k = 0; k < layout.params[c].size(); ++k) {
      const ParamIndex root = bundle.Root(c, k);
      layout.params[c][k] = layout.params[root.camera][root.param];
    }
  }
  layout.markers = bundle.EstimatesMarkers() && !bundle.HasLandmarks();
  layout.total = layout.head + (layout.markers ? 3 * static_cast<int>(bundle.markers.size()) : 0);
  return layout;
}

}  // namespace plenocal::internal
