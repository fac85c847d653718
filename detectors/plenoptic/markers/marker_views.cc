// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/marker_views.h"

#include <cmath>
#include <utility>

namespace plenocal {
namespace {

using internal::MarkerMeasurement;
using internal::MeasuredRange;
using internal::RawMeasurements;

/// k_pixel, px^2: a pixel's area has a variance of 1 / 12, its point spread one of up to 0.6^2,
/// evenly distributed: mean range / 2, variance range^2 / 12.
constexpr double kPixelArea = 1 / 12.0, kPointSpread = 0.36;
constexpr double kPixelMean = kPixelArea + kPointSpread / 2;
const double kPixelSigma = kPointSpread / std::sqrt(12.0);
/// k, px^2: an aperture's covariance is about 1 where it blurs by a pixel.
constexpr double kApertureSigma = 1;

/// Gradient of ln v across a tilted array, 1 / px: that of 10 mrad where B is 33 px.
constexpr double kGradientSigma = 3e-4;

/// Displacement of a measurement by one standard deviation of k_pixel, of the two k of each lens
/// type (at the nearest and at the farthest marker) and, of a tilted array, of the two changes of
/// these across it (B changes there, and the depth in focus with it) and of the gradient of ln v
/// that the tilt makes from micro lens to micro lens, which one micro image does not have. Rows x
/// and y.
std::vector<double> ByNuisance(int types,
                               const MeasuredRange& range,
                               bool tilted,
                               const MarkerMeasurement& m) {
  using Rows = Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor>;
  const int of_type = tilted ? 4 : 2;
  Rows by = Rows::Zero(2, 1 + of_type * types + (tilted ? 2 : 0));
  by.col(0) = kPixelSigma * m.vignetting_sensitivity.col(0);
  Eigen::RowVector4d k;
  k << range.DepthWeights(m.inverse_depth).transpose(), range.Place(m.Centre()).transpose();
  by.middleCols(1 + of_type * m.lens_type, of_type) =
      kApertureSigma * m.vignetting_sensitivity.col(1) * k.head(of_type);
  // 1/v is proportional to (B + delta) / (B v + delta), delta the change of B.
  if (tilted) by.rightCols<2>() = kGradientSigma * (1 - m.inverse_depth) * m.gradient_sensitivity;
  return {by.data(), by.data() + by.size()};
}

Observation ObservationOf(const MarkerMeasurement& m) {
  Observation seen = m.observation;
  seen.lens_type = m.lens_type;
  const Eigen::Vector2d moved = kPixelMean * m.vignetting_sensitivity.col(0);
  seen.values[0] -= moved.x();
  seen.values[1] -= moved.y();
  seen.values[4] = 1 / m.inverse_depth;
  seen.values[5] = m.depth_sensitivity.x();
  seen.values[6] = m.depth_sensitivity.y();
  return seen;
}

}  // namespace

std::vector<View> MarkerViews(const std::vector<std::string>& frames,
                              int lens_types,
                              const std::vector<RawMeasurements>& images,
                              bool tilted) {
  const MeasuredRange range(images);
  std::vector<View> views;
  for (size_t i = 0; i < images.size(); ++i) {
    View view{.frame = frames[i], .observations = {}};
    for (const MarkerMeasurement& m : images[i]) {
      view.observations.push_back(ObservationOf(m));
      view.by_nuisance.push_back(ByNuisance(lens_types, range, tilted, m));
    }
    if (!view.observations.empty()) views.push_back(std::move(view));
  }
  return views;
}

}  // namespace plenocal
