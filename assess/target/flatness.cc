// SPDX-License-Identifier: Apache-2.0
#include "assess/target/flatness.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "assess/projection.h"
#include "assess/target/plane_view.h"
#include "calib/base/error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "calib/estimate/solve.h"
#include "calib/noise/frame_scatter.h"

namespace plenocal {
namespace {

constexpr double kBentFalseAlarm = 1e-6;
// Differences of the projection, px. Whoever measures in images takes a tenth of a pixel for exact;
// a pixel is larger than any detector's error.
constexpr double kNegligible = 0.1, kWholePixel = 1;
// Noise with held markers over that with free ones: from here on more than half of the variance is
// the target's.
constexpr double kBentExplains = 1.4142;
// Prior of free markers, of the target's radius: sheets that bend farther are no targets.
constexpr double kLoose = 0.02;

std::map<int, Eigen::Vector3d> Nominal(const Bundle& bundle) {
  std::map<int, Eigen::Vector3d> markers;
  for (const BundleMarker& marker : bundle.markers) markers[marker.number] = marker.nominal;
  return markers;
}

std::vector<double> TypicalSigmas(const Bundle& bundle) {
  std::vector<std::vector<double>> sigmas(bundle.cameras.size());
  for (const BundleObservation& observation : bundle.observations) {
    sigmas[static_cast<size_t>(observation.camera)].push_back(observation.assumed_sigma);
  }
  std::vector<double> typical;
  for (const std::vector<double>& of_camera : sigmas) typical.push_back(Median(of_camera, 1.0));
  return typical;
}

// What else makes the frames disagree moves free markers too.
void AddFrameErrors(Calibration* calibration) {
  std::vector<double> factors;
  const SystematicScatter found = EstimateScatter(calibration->bundle, calibration->uncertainty);
  for (const Scatter& scatter : found.of_frames) {
    factors.push_back(scatter.degrees >= 1 ? std::max(1.0, scatter.factor) : 1);
  }
  ScaleByScatter(factors, &calibration->uncertainty);
}

// The same calibration with another freedom of the markers; nothing when it fails.
std::optional<Calibration> WithMarkers(const Calibration& calibration,
                                       MarkerFreedom marker_freedom,
                                       const SolveOptions& options) {
  Calibration other = calibration;
  other.bundle.marker_freedom = marker_freedom;
  try {
    other.uncertainty = Solve(options, &other.bundle).uncertainty;
    AddFrameErrors(&other);
  } catch (const Error&) {
    return std::nullopt;
  }
  return other;
}

// Probability that free markers improve the residuals so much when the target is as stated.
double ChanceOfGain(const Calibration& held,
                    const Calibration& free,
                    const std::vector<double>& typical) {
  double gain = 0, unknowns = 0, left = 0;
  for (size_t c = 0; c < typical.size(); ++c) {
    const double before = held.bundle.cameras[c].noise.Sigma(typical[c]);
    const double after = free.bundle.cameras[c].noise.Sigma(typical[c]);
    const double of_held = held.uncertainty.redundancy[c];
    const double of_free = free.uncertainty.redundancy[c];
    gain += of_held * before * before / (after * after) - of_free;
    unknowns += of_held - of_free;
    left += of_free;
  }
  return gain > 0 && unknowns > 1 && left > 1 ? FTail(gain / unknowns, unknowns, left) : 1;
}

/// Effect on one camera.
struct Effect {
  double projection = 0;     ///< RMS over the supported image, px; infinite: no pixel in common
  std::string focal_change;  ///< "f_x by +0.8 %"
};

Effect EffectOn(const Calibration& held, const Calibration& free, size_t c) {
  const std::array camera{c};
  const double difference = SupportedDifference(held, free, camera);
  Effect effect;
  // What both calibrations state as their uncertainty may be chance.
  constexpr double kChance = 3;  // standard errors
  if (std::isinf(difference) || difference > kChance * SupportedSigma(free, camera)) {
    effect.projection = difference;
  }
  const BundleCamera &a = held.bundle.cameras[c], &b = free.bundle.cameras[c];
  for (size_t k = 0; k < a.ModelParams(); ++k) {
    const std::string_view name = a.model->params[k].name;
    if (name != "f_x" && name != "f_L") continue;
    effect.focal_change =
        fmt::format("{} of {} by {:+.2g} %", name, a.name, 100 * (b.params[k] / a.params[k] - 1));
  }
  return effect;
}

/// Deviations of the free markers from the stated ones.
struct Shape {
  double out_of_plane = 0;  ///< peak to peak, m
  double coordinate = 0;    ///< RMS of a coordinate, m
};

Shape ShapeOf(const Bundle& free, const MarkerPlane& plane) {
  // Without the displacement and tilt of the whole, a x + b y + c.
  const auto count = static_cast<Eigen::Index>(free.markers.size());
  const Eigen::Vector3d normal = plane.x.cross(plane.y);
  Eigen::MatrixXd A(count, 3);
  Eigen::VectorXd z(count);
  double sum = 0;
  for (Eigen::Index i = 0; i < count; ++i) {
    const BundleMarker& marker = free.markers[static_cast<size_t>(i)];
    const Eigen::Vector2d at = plane(marker.nominal);
    A.row(i) << at.x(), at.y(), 1;
    z[i] = normal.dot(marker.position - marker.nominal);
    sum += (marker.position - marker.nominal).squaredNorm();
  }
  const Eigen::VectorXd off = z - A * LeastSquares(A, z);
  return {off.maxCoeff() - off.minCoeff(), std::sqrt(sum / (3.0 * static_cast<double>(count)))};
}

}  // namespace

std::optional<BentTarget> FindBentTarget(const Calibration& calibration,
                                         Loss loss,
                                         const std::function<bool()>& go_on) {
  const Bundle& bundle = calibration.bundle;
  const std::optional<MarkerPlane> plane = FindPlane(Nominal(bundle));
  if (!bundle.marker_freedom.IsHeld() || !plane) return std::nullopt;
  const std::vector<double> typical = TypicalSigmas(bundle);
  const SolveOptions options{typical, loss, go_on};
  // Solved again, since `calibration` may be a part of a longer one.
  const std::optional<Calibration> held = WithMarkers(calibration, MarkerFreedom::Rigid(), options);
  const std::optional<Calibration> free =
      WithMarkers(calibration, MarkerFreedom::FromSigma(kLoose * plane->extent), options);
  if (!held || !free || ChanceOfGain(*held, *free, typical) > kBentFalseAlarm) return std::nullopt;
  double largest = 0;
  std::string focal_change;
  std::vector<std::string> cameras;
  std::vector<double> residual;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    residual.push_back(free->bundle.cameras[c].noise.Sigma(typical[c]));
    const double ratio = held->bundle.cameras[c].noise.Sigma(typical[c]) / residual.back();
    const Effect effect = EffectOn(*held, *free, c);
    if (std::isinf(effect.projection)) return std::nullopt;  // one of them is no lens any more
    if (effect.projection < kNegligible && ratio < kBentExplains) continue;
    cameras.push_back(bundle.cameras[c].name);
    if (effect.projection > largest) {
      largest = effect.projection;
      focal_change = effect.focal_change;
    }
  }
  if (cameras.empty()) return std::nullopt;
  const Shape shape = ShapeOf(free->bundle, *plane);
  Finding finding{
      .code = "target_not_flat",
      .role = FindingRole::kTargetCause,
      .grade = largest < kWholePixel ? Grade::kUsable : Grade::kBad,
      .cameras = cameras,
      .value = largest,
      .limit = largest < kWholePixel ? kNegligible : kWholePixel,
      .what = fmt::format(
          "the target deviates from its file: {:.2g} mm out of its plane from peak to "
          "peak, {:.2g} mm RMS per coordinate in all; estimated with the "
          "cameras it changes {}",
          1e3 * shape.out_of_plane,
          1e3 * shape.coordinate,
          largest > 0
              ? fmt::format("the projection by {:.2g} px{}{}",
                            largest,
                            focal_change.empty() ? "" : ", ",
                            focal_change)
              : std::string("the residuals, but no camera by more than its standard errors")),
      .remedy = fmt::format("set tolerance: {:.1g} mm in the target's file, so that its shape is "
                            "estimated too, or use a flat board",
                            1e3 * shape.coordinate)};
  return BentTarget{std::move(finding), std::move(residual)};
}

}  // namespace plenocal
