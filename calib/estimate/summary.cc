// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/summary.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <string_view>

#include "calib/base/number_text.h"
#include "calib/rig/extrinsics.h"

namespace plenocal {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

// Value with as many digits as its sigma justifies (two digits of the sigma).
std::string WithSigma(double value, double sigma) {
  if (!(sigma > 0)) return fmt::format("{:.9g}", value);
  if (std::isinf(sigma)) return fmt::format("{:.6g}  (not determined)", value);
  const int digits = std::clamp(1 - static_cast<int>(std::floor(std::log10(sigma))), 0, 12);
  return fmt::format("{:.{}f} +- {:.{}f}", value, digits, sigma, digits);
}

// The session's rules about a parameter.
std::string RuleText(const Bundle& bundle, size_t c, size_t k) {
  const BundleCamera& camera = bundle.cameras[c];
  std::string text = camera.fixed[k] ? "  (fixed)" : "";
  const auto by_others = k < camera.ModelParams() ? camera.model->params[k].by_others : nullptr;
  if (by_others != nullptr && camera.params[k] == by_others(camera.params.data())) {
    text = "  (by the others)";
  }
  if (camera.rules.empty()) return text;
  const ParamIndex root = bundle.Root(c, k);
  const ParamRule& rule = bundle.cameras[root.camera].rules[root.param];
  if (root != ParamIndex{c, k}) {
    text += fmt::format("  (tied to {}{})",
                        root.camera == c ? "" : bundle.cameras[root.camera].name + ".",
                        bundle.cameras[root.camera].model->params[root.param].name);
  }
  if (camera.at_bound[k]) text += "  (at its bound)";
  if (rule.prior) {
    text += fmt::format("  (prior {:g} +- {:g})", rule.prior->value, rule.prior->sigma);
  }
  return text;
}

// The noise floor beside the RMS: a gap between them is an error of model or target, not noise.
std::string FloorText(const CameraFit& fit) {
  if (!fit.noise_floor || !fit.noise_floor_all) return {};
  const NoiseFloor &floor = *fit.noise_floor, &floor_all = *fit.noise_floor_all;
  const double per_coordinate = floor.coordinate / floor.length;
  return fmt::format(
      "  noise floor of the affine law {:.4f} px, with third order {:.4f} px; RMS of a coordinate "
      "{:.4f} px, noise floor {:.4f} ({:.0f} degrees of freedom), with third order {:.4f}; with the "
      "rejected points {:.4f}, noise floor {:.4f}, with third order {:.4f}\n",
      floor.length,
      floor.third_order,
      fit.rms * per_coordinate,
      floor.coordinate,
      floor.redundancy,
      floor.third_order * per_coordinate,
      fit.rms_all * per_coordinate,
      floor_all.coordinate,
      floor_all.third_order * per_coordinate);
}

std::string LensTypeText(const CameraFit& fit) {
  if (fit.lens_types.empty()) return {};
  std::string text = "  RMS by lens type:";
  for (const auto& [number, type] : fit.lens_types) {
    text += fmt::format("{} {:.4f} px over {}",
                        number == fit.lens_types.begin()->first ? "" : ",",
                        type.rms,
                        type.points);
  }
  return text + " points\n";
}

std::string FitText(const CameraFit& fit) {
  std::string text = fmt::format(
      "  RMS reprojection error {:.4f} px over {} in {}, {} rejected; noise {:.4f} px "
      "per coordinate",
      fit.rms,
      Counted(static_cast<size_t>(fit.points), "point"),
      Counted(static_cast<size_t>(fit.views), "image"),
      fit.rejected,
      fit.noise_sigma);
  if (fit.detector_sigma > 0) text += fmt::format(" (detector: {:.4f})", fit.detector_sigma);
  if (fit.common_noise > 0) {
    text += fmt::format(", {:.4f} of it common to the points of a marker", fit.common_noise);
  }
  return text + '\n' + FloorText(fit) + LensTypeText(fit);
}

std::string ParametersText(const Calibration& calibration, size_t c) {
  const BundleCamera& camera = calibration.bundle.cameras[c];
  std::string text;
  std::vector<std::string_view> of_field;
  for (size_t i = 0; i < camera.ModelParams(); ++i) {
    const Param& param = camera.model->params[i];
    if (param.prior_sigma > 0) {
      of_field.push_back(param.name);
      continue;
    }
    text += fmt::format(
        "    {:<6} {}{}{}{}\n",
        param.name,
        WithSigma(camera.params[i], calibration.uncertainty.param_std_errors[c][i]),
        param.unit == "1" ? "" : fmt::format(" {}", param.unit),
        RuleText(calibration.bundle, c, i),
        calibration.jackknife && !camera.fixed[i]
            ? fmt::format("  (jackknife +- {:.2g})", calibration.jackknife->param_std_errors[c][i])
            : "");
  }
  if (!of_field.empty()) {
    text += fmt::format("    {} ... {}: {} coefficients of a field over the image\n",
                        of_field.front(),
                        of_field.back(),
                        of_field.size());
  }
  return text;
}

std::string RotationText(const Eigen::Matrix3d& R, const Matrix6d& covariance) {
  const Eigen::Vector3d w = LogRotation(R) * kDegrees;
  const Eigen::Vector3d sigma = covariance.diagonal().tail<3>().cwiseMax(0).cwiseSqrt() * kDegrees;
  const std::array axes{
      WithSigma(w.x(), sigma.x()), WithSigma(w.y(), sigma.y()), WithSigma(w.z(), sigma.z())};
  return fmt::format("rotation vector ({}) degrees\n", fmt::join(axes, ", "));
}

std::string ExtrinsicsText(const Calibration& calibration, size_t c) {
  const RigidTransform& T_camera_rig = calibration.bundle.cameras[c].T_camera_rig;
  const Matrix6d chart = LogJacobian(T_camera_rig);
  const std::vector<Extrinsic> extrinsics = ExtrinsicsOf(
      T_camera_rig, chart * calibration.uncertainty.extrinsics_covariance[c] * chart.transpose());
  std::map<std::string_view, std::string> text;
  for (const Extrinsic& each : extrinsics) text[each.name] = WithSigma(each.value, each.sigma);
  const Eigen::Vector3d centre = 1e3 * T_camera_rig.Inverse().t;
  return fmt::format(
      "    extrinsics relative to {}: baseline {} mm, centre ({:.3f}) mm\n"
      "    rotation vector ({}, {}, {}) degrees\n",
      calibration.bundle.cameras[0].name,
      text["baseline"],
      fmt::join(centre, ", "),
      text["rotation about x"],
      text["rotation about y"],
      text["rotation about z"]);
}

std::string TimeShiftText(const Calibration& calibration, size_t c) {
  const BundleCamera& camera = calibration.bundle.cameras[c];
  const size_t index = *camera.Find(nuisances::kTimeShift);
  return fmt::format("    images later than their times by {} ms, by the clock of {}\n",
                     WithSigma(1e3 * camera.params[index],
                               1e3 * calibration.uncertainty.param_std_errors[c][index]),
                     calibration.bundle.cameras[0].name);
}

std::string ScaleText(const Calibration& calibration) {
  std::string text;
  const Uncertainty& uncertainty = calibration.uncertainty;
  for (size_t k = 0; uncertainty.scale_index >= 0 && k < calibration.bundle.scales.size(); ++k) {
    const TargetScale& scale = calibration.bundle.scales[k];
    const auto i = uncertainty.scale_index + static_cast<Eigen::Index>(k);
    text +=
        fmt::format("\n{}: {} % larger than stated\n",
                    NameOfScale(calibration.bundle, scale),
                    WithSigma(100 * scale.value, 100 * std::sqrt(uncertainty.covariance(i, i))));
  }
  return text;
}

std::string TargetText(const Bundle& bundle) {
  if (!bundle.marker_freedom.HasTolerance() || bundle.marker_freedom.IsHeld()) return {};
  double sum = 0, largest = 0;
  int worst = 0;
  for (size_t m = 0; m < bundle.markers.size(); ++m) {
    const BundleMarker& marker = bundle.markers[m];
    const double moved = (marker.position - bundle.Expected(static_cast<int>(m))).norm();
    sum += moved * moved;
    if (moved > largest) {
      largest = moved;
      worst = marker.number;
    }
  }
  return fmt::format(
      "\nrefined markers are {:.3f} mm RMS from their nominal positions (tolerance {:.3f} mm per "
      "coordinate), at most {:.3f} mm (marker {})\n",
      1e3 * std::sqrt(sum / static_cast<double>(bundle.markers.size())),
      1e3 * bundle.marker_freedom.Sigma(),
      1e3 * largest,
      worst);
}

// The poses of targets that were estimated.
std::string TargetPosesText(const Calibration& calibration) {
  std::string text;
  for (size_t k = 0; k < calibration.bundle.targets.size(); ++k) {
    const BundleTarget& target = calibration.bundle.targets[k];
    const int place = calibration.uncertainty.target_index[k];
    if (place < 0) continue;
    const Matrix6d covariance = calibration.uncertainty.covariance.block<6, 6>(place, place);
    const Eigen::Vector3d along = target.T_target_own.t.normalized();
    const double sigma = std::sqrt(along.dot(covariance.topLeftCorner<3, 3>() * along));
    text += fmt::format("\ntarget {}: {} mm from {}, {}",
                        target.name,
                        WithSigma(1e3 * target.T_target_own.t.norm(), 1e3 * sigma),
                        calibration.bundle.targets[0].name,
                        RotationText(target.T_target_own.R, covariance));
  }
  return text;
}

}  // namespace

std::string Summary(const Calibration& calibration) {
  const Bundle& bundle = calibration.bundle;
  std::string text =
      fmt::format("{}, {}, {}; {}, {}\n",
                  Counted(bundle.cameras.size(), "camera"),
                  Counted(calibration.frames.size(), "frame"),
                  Counted(bundle.markers.size(), bundle.HasLandmarks() ? "scene point" : "marker"),
                  Counted(static_cast<size_t>(calibration.iterations), "iteration"),
                  calibration.converged ? "converged" : "NOT CONVERGED");
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const BundleCamera& camera = bundle.cameras[c];
    text += fmt::format("\n{}  ({}, {} x {} px)\n",
                        camera.name,
                        camera.model->name,
                        camera.image_size[0],
                        camera.image_size[1]);
    text += FitText(calibration.fits[c]) + ParametersText(calibration, c);
    if (!camera.is_master) text += ExtrinsicsText(calibration, c);
    if (camera.Find(nuisances::kTimeShift)) text += TimeShiftText(calibration, c);
  }
  return text + TargetPosesText(calibration) + ScaleText(calibration) + TargetText(bundle);
}

}  // namespace plenocal
