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
  for (const double blur : blurs) deviations.push_back(std::abs(blur - median.blur));
  median.sigma = kMedianLoss * kSigmaPerMad * Median(deviations) /
                 std::sqrt(static_cast<double>(markers.size()));
  return median;
}

}  // namespace

std::vector<BlurMeasurement> MeasureBlur(std::span<const RawMeasurements> images) {
  constexpr std::ptrdiff_t kTogether = 25;  // markers of a median, at least
  std::vector<BlurMeasurement> all;
  for (const RawMeasurements& image : images) {
    std::map<int, std::vector<const MarkerMeasurement*>> of_type;
    for (const MarkerMeasurement& m : image) {
      if (m.blur_sigma > 0) of_type[m.lens_type].push_back(&m);
    }
    for (auto& [type, markers] : of_type) {
      std::ranges::sort(markers, {}, [](const MarkerMeasurement* m) { return m->inverse_depth; });
      const std::ptrdiff_t groups = std::ssize(markers) / kTogether;
      for (std::ptrdiff_t g = 0; g < groups; ++g) {
        const std::ptrdiff_t from = g * std::ssize(markers) / groups;
        const std::ptrdiff_t to = (g + 1) * std::ssize(markers) / groups;
        const BlurMeasurement median =
            MedianOf(std::span<const MarkerMeasurement* const>(markers).subspan(from, to - from));
        if (median.blur > 0 && median.sigma > 0) all.push_back(median);
      }
    }
  }
  return all;
}

}  // namespace plenocal::internal
