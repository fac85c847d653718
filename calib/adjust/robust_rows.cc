// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/robust_rows.h"

#include <algorithm>
#include <cmath>

namespace plenocal::internal {
namespace {

// Factor on a residual of length `s` (in sigmas), with its derivative to s^2.
struct RobustFactor {
  double factor = 1;
  double derivative = 0;  // d factor / d (s^2)
};

RobustFactor RobustFactorOf(const RobustLoss& robust, double s2) {
  const double width = robust.width;
  if (robust.loss == Loss::kHuber && s2 > width * width) {
    // rho = 2 k s - k^2
    const double s = std::sqrt(s2);
    const double rho = 2 * width * s - width * width;
    const double factor = std::sqrt(rho / s2);
    return {factor, (width / (s * s2) - rho / (s2 * s2)) / (2 * factor)};
  }
  if (robust.loss == Loss::kCauchy && s2 > 0) {
    // rho = k^2 log(1 + s^2 / k^2)
    constexpr double kSeries = 1e-8;  // below, the first term of the series is exact to rounding
    const double k2 = width * width, q = s2 / k2;
    const double factor = std::sqrt(std::log1p(q) / q);
    if (q < kSeries) return {1, -0.25 / k2};
    return {factor, (1 / (s2 * (1 + q)) - std::log1p(q) / (q * s2)) / (2 * factor)};
  }
  return {};
}

}  // namespace

void Robustify(const RobustLoss& loss,
               const BundleCamera& camera,
               double assumed_sigma,
               const LinearisedRows& out) {
  if (loss.loss == Loss::kNone) return;
  const size_t rows = camera.model->measured.size();
  const double part = camera.noise.OwnSigma(assumed_sigma) / camera.noise.Sigma(assumed_sigma);
  double s2 = 0;
  for (size_t r = 0; r < rows; ++r) s2 += out.residual[r] * out.residual[r];
  RobustFactor robust = RobustFactorOf(loss, part * part * s2);
  robust.derivative *= part * part;
  if (robust.factor == 1 && robust.derivative == 0) return;
  const auto scale = [&](double* J, size_t columns) {
    if (J == nullptr) return;
    for (size_t c = 0; c < columns; ++c) {
      double along = 0;
      for (size_t r = 0; r < rows; ++r) along += out.residual[r] * J[r * columns + c];
      for (size_t r = 0; r < rows; ++r) {
        double& entry = J[r * columns + c];
        entry = robust.factor * entry + 2 * robust.derivative * along * out.residual[r];
      }
    }
  };
  scale(out.J_params, camera.params.size());
  scale(out.J_extrinsics, 6);
  scale(out.J_pose, 6);
  scale(out.J_jitter, 6);
  scale(out.J_marker, 3);
  for (size_t r = 0; r < rows; ++r) out.residual[r] *= robust.factor;
}

void ClearDerivatives(const BundleCamera& camera, const LinearisedRows& out) {
  const size_t rows = camera.model->measured.size();
  if (out.J_params != nullptr) std::fill_n(out.J_params, rows * camera.params.size(), 0.0);
  for (double* J : {out.J_extrinsics, out.J_pose, out.J_jitter}) {
    if (J != nullptr) std::fill_n(J, rows * 6, 0.0);
  }
  if (out.J_marker != nullptr) std::fill_n(out.J_marker, rows * 3, 0.0);
}

}  // namespace plenocal::internal
