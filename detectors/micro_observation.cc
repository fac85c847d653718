// SPDX-License-Identifier: Apache-2.0
#include "detectors/micro_observation.h"

#include <algorithm>

namespace plenocal::internal {

std::vector<std::span<const MicroObservation>> RunsOf(std::span<const MicroView> views) {
  std::vector<std::span<const MicroObservation>> runs;
  for (const MicroView& view : views) {
    for (size_t begin = 0, end = 0; begin < view.size(); begin = end) {
      while (end < view.size() && view[end].seen.marker == view[begin].seen.marker) ++end;
      if (end - begin > 2) runs.emplace_back(view.data() + begin, end - begin);
    }
  }
  return runs;
}

DepthLine::DepthLine(std::span<const MicroView> views) {
  for (const MicroView& view : views) {
    for (const MicroObservation& o : view) {
      low_ = std::min(low_, o.inverse_depth);
      high_ = std::max(high_, o.inverse_depth);
    }
  }
}

Eigen::Vector2d DepthLine::At(double inverse_depth) const {
  const double t = high_ > low_ ? (inverse_depth - low_) / (high_ - low_) : 0;
  return {1 - t, t};
}

double CauchyWeight(double residual, double mean_square) {
  return 1 / (1 + residual * residual / (9 * mean_square));
}

}  // namespace plenocal::internal
