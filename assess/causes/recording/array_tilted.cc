// SPDX-License-Identifier: Apache-2.0
//
// A micro-lens array that is tilted against the sensor, before a model without a tilt.
#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>

#include "assess/causes/cause.h"
#include "calib/base/statistics.h"
#include "calib/camera/lens_type_optics.h"
#include "calib/camera/micro_lens_array.h"
#include "calib/estimate/common_errors.h"
#include "calib/noise/uncertainty.h"

namespace plenocal {
namespace {

constexpr double kTiltLevel = 1e-3;  // false alarms, a camera

/// Places of the distances among the parameters of a plenoptic model without a tilt
/// (models/start/plenoptic_model.h).
struct Distances {
  size_t f_L, b_L0, B, b_P, c_x, c_y;
  bool inverse = false;  ///< w_P = 1 / b_P stands in the place of b_P

  static std::optional<Distances> Of(const CameraModel& model) {
    const auto find = [&](std::string_view name) {
      return static_cast<size_t>(std::ranges::find(model.params, name, &Param::name) -
                                 model.params.begin());
    };
    const size_t count = model.params.size();
    Distances of{find("f_L"), find("b_L0"), find("B"), find("b_P"), find("c_x"), find("c_y")};
    if (!model.plenoptic || HasTilt(model) || of.B == count) return std::nullopt;
    of.inverse = find("w_P") != count;
    if (of.inverse) of.b_P = find("w_P");
    if (of.b_P == count) of.b_P = of.b_L0;
    return of;
  }
  [[nodiscard]] double Pupil(const std::vector<double>& p) const {
    return inverse ? PupilDistance(p[b_P]) : p[b_P];
  }
};

/// The bundle with the tilt as two more shared errors of a camera, in units of `unit` rad: a micro
/// lens is t . c_ML farther from the sensor and nearer to main lens and pupil.
Bundle WithTilt(const Bundle& bundle, size_t c, const Distances& of, double unit) {
  const BundleCamera& camera = bundle.cameras[c];
  const std::vector<double>& p = camera.params;
  const double pupil = of.Pupil(p);
  const auto by_tilt = [&](const Observation& seen, const Eigen::MatrixXd& J) -> Eigen::MatrixXd {
    const auto column = [&](size_t k) { return J.col(static_cast<Eigen::Index>(k)); };
    Eigen::Vector2d by_delta = column(of.B) - column(of.b_L0);
    if (of.b_P != of.b_L0) by_delta -= column(of.b_P) * (of.inverse ? -1 / (pupil * pupil) : 1);
    const Eigen::Vector2d c_ML =
        Eigen::Vector2d(seen.values[2] - p[of.c_x], seen.values[3] - p[of.c_y]) *
        (camera.config[0] * pupil / (pupil + p[of.B]));
    return unit * by_delta * c_ML.transpose();
  };
  return WithSharedErrors(bundle, c, 2, by_tilt);
}

/// Relative error of distances about `z` through a micro lens that is `delta` farther from the
/// sensor than assumed (docs/plenoptic.md, "Tilted arrays").
double DistanceError(const std::vector<double>& p, const Distances& of, double z, double delta) {
  const double e = p[of.f_L] - p[of.b_L0];
  const double by_z = e * (e + of.Pupil(p)) / (p[of.f_L] * p[of.f_L] * of.Pupil(p));
  return std::abs(delta) / p[of.B] * std::abs(1 + by_z * z);
}

double MedianDistance(const Bundle& bundle, size_t c) {
  std::vector<double> distances;
  for (size_t frame = 0; frame < bundle.T_rig_target.size(); ++frame) {
    distances.push_back((bundle.cameras[c].T_camera_rig * bundle.T_rig_target[frame]).t.norm());
  }
  return Median(distances);
}

std::vector<Finding> FindTilt(const CauseEvidence& evidence) {
  const Bundle& bundle = evidence.calibration->bundle;
  const size_t c = evidence.camera;
  const BundleCamera& camera = bundle.cameras[c];
  const std::optional<Distances> of = Distances::Of(*camera.model);
  if (!of || camera.params[of->B] <= 0) return {};
  constexpr double kUnit = 0.1;  // rad, a weak prior: half of such an array would touch the sensor
  const Uncertainty with = EstimateUncertainty(WithTilt(bundle, c, *of, kUnit));
  const int first = with.param_index[c].end()[-2];
  if (first < 0 || with.frames_gradient.size() == 0) return {};
  // The other unknowns are at their optimum: their gradient is zero.
  const Eigen::Matrix2d covariance = with.covariance.block<2, 2>(first, first);
  const Eigen::Vector2d gradient = with.frames_gradient.segment<2>(first);
  const Eigen::Vector2d t = -covariance * gradient;
  const double F = t.dot(-gradient) / 2;
  if (!(FTail(F, 2, with.redundancy[c]) < kTiltLevel)) return {};

  const double half = std::min(camera.image_size[0], camera.image_size[1]) * camera.config[0] / 2;
  const double z = MedianDistance(bundle, c), angle = kUnit * t.norm();
  const double error = DistanceError(camera.params, *of, z, angle * half);
  constexpr double kUsable = 0.003, kBad = 0.02;
  if (error < kUsable) return {};
  return {
      {.code = "array_tilted",
       .role = FindingRole::kCause,
       .grade = error < kBad ? Grade::kUsable : Grade::kBad,
       .value = angle,
       .limit = 0,
       .what = fmt::format(
           "the micro-lens array is tilted against the sensor by about {:.2g} mrad (t_x {:.2g}, t_y {:.2g}), which {} "
           "takes as parallel: distances at {:.2g} m are up to {:.2g} % off towards the edges of the image.",
           1e3 * angle,
           1e3 * kUnit * t.x(),
           1e3 * kUnit * t.y(),
           camera.model->name,
           z,
           100 * error),
       .remedy = "Set model: focused-plenoptic-tilt, or compare both with 'plenocal try'."}};
}

}  // namespace

Cause ArrayTiltedCause() { return {CauseStage::kPoints, FindTilt}; }

}  // namespace plenocal
