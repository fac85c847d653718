// SPDX-License-Identifier: Apache-2.0
//
// Markers most of whose points were rejected.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "assess/causes/cause.h"
#include "assess/causes/residual_tests.h"

namespace plenocal {
namespace {

constexpr double kMarkerLevel = 1e-4;  // false alarms, a camera

/// Number of points of one marker.
struct Share {
  int all = 0, rejected = 0;
};

// Probability of so many rejections among `share.all` points when each is rejected with
// `probability`: Chernoff's bound.
double ChanceOf(const Share& share, double probability) {
  const double part = static_cast<double>(share.rejected) / share.all;
  if (part <= probability) return 1;
  double information = part * std::log(part / probability);
  if (part < 1) information += (1 - part) * std::log((1 - part) / (1 - probability));
  return std::exp(-share.all * information);
}

std::vector<Finding> FindMarkerOutliers(const CauseEvidence& evidence) {
  constexpr double kMostPoints = 0.3;   // of a marker; less than that are single bad points
  constexpr double kFewMarkers = 0.25;  // many are no exceptions
  constexpr double kLeastShare = 0.01;  // rejected in any recording
  const Bundle& bundle = evidence.calibration->bundle;
  std::map<int, Share> shares;
  Share total;
  for (const BundleObservation& observation : bundle.observations) {
    if (observation.camera != static_cast<int>(evidence.camera)) continue;
    Share& share = shares[bundle.markers[static_cast<size_t>(observation.marker)].number];
    for (Share* one : {&share, &total}) {
      ++one->all;
      if (!observation.used) ++one->rejected;
    }
  }
  std::vector<std::string> names;
  double worst = 0;
  for (const auto& [number, share] : shares) {
    const double part = static_cast<double>(share.rejected) / share.all;
    const int others = std::max(1, total.all - share.all);
    const double usual =
        std::max(kLeastShare, static_cast<double>(total.rejected - share.rejected) / others);
    if (part < kMostPoints || usual >= 1 ||
        ChanceOf(share, usual) > kMarkerLevel / static_cast<double>(shares.size())) {
      continue;
    }
    names.push_back(fmt::format("{} ({} of {})", number, share.rejected, share.all));
    worst = std::max(worst, part);
  }
  if (names.empty() || static_cast<double>(names.size()) > kFewMarkers * shares.size()) return {};
  return {{.code = "marker_outlier",
           .role = FindingRole::kOutlier,
           .grade = Grade::kUsable,
           .value = worst,
           .limit = kMostPoints,
           .what = fmt::format("{} with all others in most images; points rejected: {}.",
                               names.size() == 1 ? "one marker disagrees" : "some markers disagree",
                               FirstNames(names)),
           .remedy = "Look for a reflection, dirt or damage there, and leave these markers out "
                     "('exclude')."}};
}

}  // namespace

Cause MarkerOutlierCause() { return {CauseStage::kPoints, FindMarkerOutliers}; }

}  // namespace plenocal
