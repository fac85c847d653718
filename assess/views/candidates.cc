// SPDX-License-Identifier: Apache-2.0
#include "assess/views/candidates.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "assess/views/projection_sigma.h"

namespace plenocal {

bool CandidatesStay(const std::vector<CandidateBasis>& made_for,
                    const std::vector<CandidateBasis>& cameras,
                    const RigUnknowns& unknowns) {
  if (made_for.size() != cameras.size()) return false;
  const auto near = [](double now, double then) { return std::abs(now - then) <= 0.05 * then; };
  for (size_t c = 0; c < cameras.size(); ++c) {
    const CandidateBasis &now = cameras[c], &then = made_for[c];
    if (now.fixed != then.fixed || !near(now.sigma_px, then.sigma_px) ||
        !near(now.range.nearest, then.range.nearest) ||
        !near(now.range.farthest, then.range.farthest)) {
      return false;
    }
    for (size_t k = 0; k < now.params.size(); ++k) {
      constexpr double kSame = 0.01;
      const int unknown = unknowns.params[c][k];
      if (unknown >= 0 &&
          std::abs(now.params[k] - then.params[k]) > kSame * unknowns.unit[unknown]) {
        return false;
      }
    }
  }
  return true;
}

std::vector<size_t> KeepSpread(std::vector<size_t> best,
                               const std::vector<TargetPose>& poses,
                               const std::vector<ImageSize>& image_sizes,
                               size_t all) {
  const size_t of_each = all / (kRegions * image_sizes.size()) + 1;
  std::map<size_t, size_t> counts;
  size_t kept = 0;
  std::erase_if(best, [&](size_t i) {
    const TargetPose& pose = poses[i];
    const size_t region = RegionOf(pose.place, image_sizes[pose.camera]);
    size_t& count = counts[kRegions * pose.camera + region];
    return kept++ >= all && ++count > of_each;
  });
  return best;
}

std::vector<double> JudgedDistances(const std::vector<CandidateBasis>& cameras, bool plenoptic) {
  double nearest = std::numeric_limits<double>::infinity(), farthest = 0;
  for (const CandidateBasis& camera : cameras) {
    nearest = std::min(nearest, camera.range.nearest);
    farthest = std::max(farthest, camera.range.farthest);
  }
  if (plenoptic) return {nearest, 2 / (1 / nearest + 1 / farthest), farthest};
  return {nearest, farthest, 10 * farthest};
}

}  // namespace plenocal
