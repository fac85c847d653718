// SPDX-License-Identifier: Apache-2.0
//
// A new cause is one file in assess/causes/recording or assess/causes/target; this one is an
// example that scripts/add tries: a target with few points.
#include <fmt/format.h>

#include <vector>

#include "assess/causes/cause.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

std::vector<Finding> FindFewPoints(const CauseEvidence& evidence) {
  constexpr size_t kLeast = 20;  // points of an image; three determine its pose
  const auto& observations = evidence.calibration->bundle.observations;
  std::vector<size_t> counts;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    end = EndOfView(observations, begin);
    if (observations[begin].camera == static_cast<int>(evidence.camera)) {
      counts.push_back(end - begin);
    }
  }
  const size_t typical = Median(counts, kLeast);
  if (typical >= kLeast) return {};
  return {{.code = "few_points",
           .role = FindingRole::kCause,
           .grade = Grade::kUsable,
           .value = static_cast<double>(typical),
           .limit = static_cast<double>(kLeast),
           .what = fmt::format("half of the images have at most {} points of the target.", typical),
           .remedy = "Use a target with more points."}};
}

}  // namespace

Cause FewPointsCause() { return {CauseStage::kPoints, FindFewPoints}; }

}  // namespace plenocal
