// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/marker_blur.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "calib/base/robust.h"
#include "calib/base/statistics.h"

namespace plenocal::internal {
namespace {

/// The median of some markers' blurs, and of their inverse depths.
BlurMeasurement MedianOf(std::span<const MarkerMeasurement* const> markers) {
  // Standard error of a median over that of a mean, for normal errors: sqrt(pi / 2).
  constexpr double kMedianLoss = 1.2533;
  std::vector<double> depths, blurs, deviations;
  for (const MarkerMeasurement* m : markers) {
    depths.push_back(m->inverse_depth);
    blurs.push_back(m->blur);
  }
  BlurMeasurement median{
      .lens_type = markers[0]->lens_type, .inverse_depth = Median(depths), .blur = Median(blurs)};
  for (const MarkerMeasurement* m : markers) {
    median.place += m->Centre() / static_cast<double>(markers.size());
  }
  for (const double blur : blurs) deviations.push_back(std::abs(blur - median.blur));
  median.sigma = kMedianLoss * kSigmaPerMad * Median(deviations) /
                 std::sqrt(static_cast<double>(markers.size()));
  return median;
}

/// Divides markers into groups of like depth and place, halving the one in which they differ most,
/// until they are too few for two groups.
void AddGroups(std::span<const MarkerMeasurement*> markers,
               const MeasuredRange& range,
               std::vector<BlurMeasurement>* all) {
  constexpr std::size_t kTogether = 25;  // markers of a median, at least
  if (markers.size() < kTogether) return;
  if (markers.size() < 2 * kTogether) {
    const BlurMeasurement median = MedianOf(markers);
    if (median.blur > 0 && median.sigma > 0) all->push_back(median);
    return;
  }
  // Each between 0 and 1 or -1 and 1: a span counts twice as much in depth, on which blur depends.
  const auto position = [&](const MarkerMeasurement* m) -> Eigen::Vector3d {
    const Eigen::Vector2d place = range.Place(m->Centre()) / 2;
    return {2 * range.DepthWeights(m->inverse_depth)[1], place.x(), place.y()};
  };
  Eigen::Vector3d least = position(markers[0]), most = least;
  for (const MarkerMeasurement* m : markers) {
    least = least.cwiseMin(position(m));
    most = most.cwiseMax(position(m));
  }
  Eigen::Index widest = 0;
  (most - least).maxCoeff(&widest);
  std::ranges::stable_sort(markers, {}, [&](const auto* m) { return position(m)[widest]; });
  AddGroups(markers.first(markers.size() / 2), range, all);
  AddGroups(markers.subspan(markers.size() / 2), range, all);
}

}  // namespace

std::vector<BlurMeasurement> MeasureBlur(std::span<const RawMeasurements> images) {
  const MeasuredRange range(images);
  std::vector<BlurMeasurement> all;
  for (const RawMeasurements& image : images) {
    std::map<int, std::vector<const MarkerMeasurement*>> of_type;
    for (const MarkerMeasurement& m : image) {
      if (m.blur_sigma > 0) of_type[m.lens_type].push_back(&m);
    }
    for (auto& [type, markers] : of_type) AddGroups(markers, range, &all);
  }
  return all;
}

}  // namespace plenocal::internal
