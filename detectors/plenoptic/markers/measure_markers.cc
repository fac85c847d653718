// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/measure_markers.h"

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>
#include <variant>

#include "calib/base/parallel.h"
#include "calib/base/statistics.h"
#include "detectors/plenoptic/depth/depth_planes.h"
#include "detectors/plenoptic/markers/template_fit.h"

namespace plenocal::internal {
namespace {

/// Largest distance of a marker from its micro-image centre, pitches. Farther out there is too
/// little light on one side of the marker: the error by vignetting grows faster than the gain of
/// the longer lever arm for the depth.
constexpr double kReach = 0.35;

/// Plane of virtual depth of each flat part: v = dot(plane, (q, 1)).
std::map<int, Eigen::Vector3d> DepthPlanes(const std::vector<MarkerTemplate>& markers,
                                           const VirtualDepth& depth) {
  std::map<int, FlatPart> points;
  for (const MarkerTemplate& marker : markers) {
    const Eigen::Vector2f pixel = (marker.position / depth.scale).cast<float>();
    points[marker.part].emplace_back(pixel.x(), pixel.y());
  }
  std::map<int, Eigen::Vector3d> planes;
  for (const auto& [part, corners] : points) {
    FlatPart hull;
    cv::convexHull(corners, hull);
    if (const auto plane = FitDepthPlane(depth, hull)) planes[part] = plane->by_q;
  }
  return planes;
}

/// The marker as a micro image is expected to show it; nothing where the depth plane has no image.
std::optional<ExpectedMarker> Expect(const MarkerTemplate& marker,
                                     const Eigen::Vector3d& plane,
                                     const Eigen::Vector2d& c) {
  // x = c + (q - c) / v(q): a homography of the virtual image.
  Eigen::Matrix3d x_by_q;
  x_by_q << c * plane.transpose(), plane.transpose();
  x_by_q.topLeftCorner<2, 2>() += Eigen::Matrix2d::Identity();
  x_by_q.topRightCorner<2, 1>() -= c;
  ExpectedMarker expected;
  expected.position = (x_by_q * marker.position.homogeneous()).hnormalized();
  Eigen::Matrix3d about = Eigen::Matrix3d::Identity();
  about.topRightCorner<2, 1>() = expected.position;
  Eigen::Matrix3d G = marker.cells_by_image * x_by_q.inverse() * about;
  G /= G(2, 2);
  if (!G.allFinite()) return std::nullopt;
  expected.cells_by_raw = G.cast<float>();
  const Eigen::Vector2d at = G.topRightCorner<2, 1>();
  const Eigen::Matrix2d slope = G.topLeftCorner<2, 2>() - at * G.bottomLeftCorner<1, 2>();
  expected.cell_px = 1 / std::sqrt(std::abs(slope.determinant()));
  return expected;
}

/// The markers in all micro images that have them well inside.
std::vector<ExpectedMarker> ExpectAll(const std::vector<MarkerTemplate>& markers,
                                      const std::map<int, Eigen::Vector3d>& planes,
                                      const MicroLensArray& array) {
  std::vector<ExpectedMarker> all;
  for (size_t i = 0; i < markers.size(); ++i) {
    const MarkerTemplate& marker = markers[i];
    const auto plane = planes.find(marker.part);
    if (plane == planes.end()) continue;
    const double v = plane->second.dot(marker.position.homogeneous());
    if (!(std::abs(v) > 1)) continue;
    const double reach = kReach * array.Pitch();
    for (size_t l = 0; l < array.lenses.size(); ++l) {
      const MicroLens& lens = array.lenses[l];
      if (!lens.usable || (marker.position - lens.centre).norm() > std::abs(v) * reach) continue;
      auto expected = Expect(marker, plane->second, lens.centre);
      if (!expected) continue;
      expected->index = i;
      expected->lens = static_cast<int>(l);
      all.push_back(*expected);
    }
  }
  return all;
}

/// Priors that the fits of one raw image share: each fit determines them weakly, all together well.
class SharedPriors {
 public:
  SharedPriors(const std::vector<MarkerTemplate>& markers,
               const LensPatches& patches,
               const MicroLensArray& array)
      : markers_(markers), patches_(patches), array_(array) {}

  /// Takes the blur of each flat part and lens type and the radius of discs from first fits.
  void Learn(const std::vector<ExpectedMarker>& expected,
             const std::vector<std::optional<TemplateFit>>& fits) {
    std::map<Group, std::vector<double>> blurs;
    std::vector<double> radii;
    double radius_sigma = 0;
    for (size_t i = 0; i < fits.size(); ++i) {
      if (!fits[i]) continue;
      const MarkerTemplate& marker = markers_[expected[i].index];
      blurs[GroupOf(expected[i])].push_back(fits[i]->blur);
      if (!std::holds_alternative<DiscTemplate>(marker.pattern)) continue;
      radii.push_back(fits[i]->shape);
      radius_sigma = ShapePrior(marker).sigma;
    }
    for (const auto& [group, values] : blurs) blurs_[group] = Together(values, kFirstBlur.sigma);
    if (!radii.empty()) radius_ = Together(radii, radius_sigma);
  }

  /// The blur that a first fit has measured, without its prior; sigma 0: the prior is all.
  static Prior Measured(const TemplateFit& first) {
    const double prior = 1 / (kFirstBlur.sigma * kFirstBlur.sigma);
    const double both = 1 / (first.blur_sigma * first.blur_sigma), own = both - prior;
    if (!(own > prior)) return {0, 0};
    return {(both * first.blur - prior * kFirstBlur.mean) / own, 1 / std::sqrt(own)};
  }

  [[nodiscard]] FitPriors Of(const ExpectedMarker& expected) const {
    const auto blur = blurs_.find(GroupOf(expected));
    FitPriors priors{
        blur == blurs_.end() ? kFirstBlur : blur->second, ShapePrior(markers_[expected.index]), 0};
    if (!radius_) return priors;
    priors.shape = *radius_;
    constexpr double kHalfPixel = 0.5;  // px, from a pixel's centre to its own edge
    priors.edge = priors.blur.mean + kHalfPixel + patches_.filter_radius;
    return priors;
  }

 private:
  using Group = std::pair<int, int>;  ///< flat part, lens type
  /// Of the blur, px: some pixels at most.
  static constexpr Prior kFirstBlur{1.0, 0.5};

  [[nodiscard]] Group GroupOf(const ExpectedMarker& expected) const {
    return {markers_[expected.index].part, array_.lenses[static_cast<size_t>(expected.lens)].type};
  }
  static Prior Together(const std::vector<double>& values, double sigma) {
    return {Median(values), sigma / std::sqrt(static_cast<double>(values.size()))};
  }

  const std::vector<MarkerTemplate>& markers_;
  const LensPatches& patches_;
  const MicroLensArray& array_;
  std::map<Group, Prior> blurs_;
  std::optional<Prior> radius_;
};

}  // namespace

RawMeasurements MeasureMarkers(const std::vector<MarkerTemplate>& markers,
                               const VirtualDepth& depth,
                               const LensPatches& patches,
                               const MicroLensArray& array,
                               const SensorNoise& noise,
                               int threads) {
  const std::map<int, Eigen::Vector3d> planes = DepthPlanes(markers, depth);
  const std::vector<ExpectedMarker> expected = ExpectAll(markers, planes, array);
  SharedPriors priors(markers, patches, array);
  std::vector<std::optional<TemplateFit>> fits(expected.size());
  const auto fit_all = [&] {
    ParallelFor(expected.size(), threads, [&](size_t i) {
      fits[i] = FitTemplate(
          markers[expected[i].index], expected[i], patches, noise, priors.Of(expected[i]));
    });
  };
  fit_all();
  priors.Learn(expected, fits);
  std::vector<Prior> blurs(fits.size(), Prior{0, 0});
  for (size_t i = 0; i < fits.size(); ++i) {
    if (fits[i]) blurs[i] = SharedPriors::Measured(*fits[i]);
  }
  fit_all();

  RawMeasurements measurements;
  for (size_t i = 0; i < fits.size(); ++i) {
    if (!fits[i]) continue;
    const TemplateFit& fit = *fits[i];
    const MarkerTemplate& marker = markers[expected[i].index];
    const double v = planes.at(marker.part).dot(marker.position.homogeneous());
    const MicroLens& lens = array.lenses[static_cast<size_t>(expected[i].lens)];
    measurements.push_back(
        {.observation =
             {.marker = marker.marker,
              .values = {fit.position.x(), fit.position.y(), lens.centre.x(), lens.centre.y()},
              .detector_sigma = fit.sigma},
         .inverse_depth = 1 / v,
         .vignetting_sensitivity = fit.vignetting_sensitivity,
         .depth_sensitivity = fit.depth_sensitivity,
         .gradient_sensitivity = v * fit.gradient_sensitivity,
         .lens_type = lens.type,
         .blur = blurs[i].mean,
         .blur_sigma = blurs[i].sigma});
  }
  std::stable_sort(measurements.begin(), measurements.end(), [](const auto& a, const auto& b) {
    return a.observation.marker < b.observation.marker;
  });
  return measurements;
}

}  // namespace plenocal::internal
