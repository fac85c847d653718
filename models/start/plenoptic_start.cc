// SPDX-License-Identifier: Apache-2.0
#include "models/start/plenoptic_start.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "calib/base/error.h"
#include "calib/base/linear_algebra.h"
#include "calib/start/camera_guess.h"

namespace plenocal {
namespace {

enum Place {
  kFocal,
  kMlaDistance,
  kSensorDistance,
  kCentreX,
  kCentreY,
  kA0,
  kA1,
  kB0,
  kB1,
  kCount
};

/// One marker in one frame, as all of its micro images together see it.
struct VirtualPoint {
  size_t view;
  int marker;
  double T;
  double variance;  // of T, up to a factor common to all points
};

constexpr double kMedians = 3;  // width of Cauchy's weights

struct VirtualImage {
  std::vector<View> views;  // q of each marker, px
  std::vector<VirtualPoint> points;
};

VirtualImage FitVirtualImage(std::span<const View> views) {
  VirtualImage image;
  for (size_t v = 0; v < views.size(); ++v) {
    std::map<int, std::vector<const Observation*>> by_marker;
    for (const Observation& seen : views[v].observations) by_marker[seen.marker].push_back(&seen);
    View virtual_view{views[v].frame, {}};
    for (const auto& [marker, seen] : by_marker) {
      if (seen.size() < 2) continue;
      // [1 0 c_x; 0 1 c_y] (u_0x, u_0y, s)' = x_R
      const auto n = static_cast<Eigen::Index>(seen.size());
      Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(2 * n, 3);
      Eigen::VectorXd measured(2 * n);
      Eigen::Vector2d mean(0, 0);
      for (const Observation* o : seen) {
        mean += Eigen::Vector2d(o->values[2], o->values[3]) / static_cast<double>(n);
      }
      double spread = 0;
      for (Eigen::Index i = 0; i < n; ++i) {
        const auto& values = seen[static_cast<size_t>(i)]->values;
        for (Eigen::Index r = 0; r < 2; ++r) {
          const auto k = static_cast<size_t>(r);
          rows(2 * i + r, r) = 1;
          rows(2 * i + r, 2) = values[2 + k] - mean[r];
          measured[2 * i + r] = values[k];
          spread += std::pow(values[2 + k] - mean[r], 2);
        }
      }
      if (!(spread > 0)) continue;
      const Eigen::Vector3d fit = RobustLeastSquares(rows, measured, kMedians);
      const double T = 1 / (1 - fit[2]);
      if (!std::isfinite(T)) continue;
      const Eigen::Vector2d q = mean + T * (fit.head<2>() - mean);
      virtual_view.observations.push_back({.marker = marker, .values = {q.x(), q.y()}});
      image.points.push_back({v, marker, T, std::pow(T, 4) / spread});
    }
    image.views.push_back(std::move(virtual_view));
  }
  return image;
}

/// Calibration of the virtual image as an ordinary camera, and T as a function of the distance.
struct VirtualCamera {
  std::vector<double> params;  // of the plenoptic camera: all but f_L, b_L0, B
  double focal = 0;            // m
  Eigen::MatrixXd line;        // rows (1, 1 / z)
  Eigen::VectorXd T, weight;

  // a and b of T = a + b / z.
  [[nodiscard]] Eigen::Vector2d FitLine() const {
    return RobustLeastSquares(weight.asDiagonal() * line, weight.cwiseProduct(T), kMedians);
  }
};

std::optional<VirtualCamera> CalibrateVirtualImage(const CameraModel& model,
                                                   const StartProblem& problem) {
  const VirtualImage image = FitVirtualImage(problem.views);
  CameraInput pinhole{.name = "virtual image",
                      .model = &model,
                      .config = {},
                      .initial = std::vector<std::optional<double>>(model.params.size()),
                      .fixed = std::vector<bool>(model.params.size(), false),
                      .image_size = problem.image_size,
                      .views = image.views};
  for (const auto& [of_pinhole, of_plenoptic] : {std::pair{2, kCentreX}, std::pair{3, kCentreY}}) {
    if (const auto& given = problem.given[of_plenoptic]) {
      pinhole.initial[of_pinhole] = *given;
      pinhole.fixed[of_pinhole] = true;
    }
  }
  std::optional<CameraGuess> guess;
  try {
    guess = GuessCamera(pinhole, *problem.markers);
  } catch (const Error&) {
    return std::nullopt;  // the caller reports that nothing explains the detections
  }

  const double pixel_size = problem.config[0];
  const double b_s = (guess->params[0] + guess->params[1]) / 2 * pixel_size;  // b_L0 + B
  std::vector<double> params(kCount, 0.0);
  params[kCentreX] = guess->params[2];
  params[kCentreY] = guess->params[3];
  // The pinhole's distortion is in units of its focal length.
  params[kA0] = guess->params[4] / (b_s * b_s);
  params[kA1] = guess->params[5] / std::pow(b_s, 4);
  for (const int k : {kA0, kA1, kB0, kB1}) params[k] = problem.given[k].value_or(params[k]);

  std::vector<std::pair<double, const VirtualPoint*>> at;  // 1 / z
  for (const VirtualPoint& point : image.points) {
    const auto& T_camera_target = guess->T_camera_target[point.view];
    if (!T_camera_target) continue;
    const double z = (*T_camera_target * problem.markers->at(point.marker)).z();
    if (z > 0) at.emplace_back(1 / z, &point);
  }
  if (at.size() < 2) return std::nullopt;
  const auto n = static_cast<Eigen::Index>(at.size());
  Eigen::MatrixXd line(n, 2);
  Eigen::VectorXd T(n), weight(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto& [inverse_z, point] = at[static_cast<size_t>(i)];
    weight[i] = 1 / std::sqrt(point->variance);
    line.row(i) << 1, inverse_z;
    T[i] = point->T;
  }

  return VirtualCamera{params, b_s, line, T, weight};
}

}  // namespace

std::vector<View> VirtualImageViews(std::span<const View> views) {
  return FitVirtualImage(views).views;
}

std::vector<StartCandidate> StartPlenoptic(const CameraModel& pinhole,
                                           const StartProblem& problem) {
  const auto camera = CalibrateVirtualImage(pinhole, problem);
  if (!camera) return {};
  const double b_s = camera->focal;
  std::vector<StartCandidate> candidates;
  const auto add = [&](double f_L, double b_L0, double B) {
    std::vector<double> params = camera->params;
    params[kFocal] = f_L;
    params[kMlaDistance] = problem.given[kMlaDistance].value_or(b_L0);
    params[kSensorDistance] = problem.given[kSensorDistance].value_or(B);
    if (f_L > 0 && params[kMlaDistance] > 0 && params[kSensorDistance] > 0) {
      candidates.push_back({params});
    }
  };
  if (!(*problem.fixed)[kFocal]) {
    const Eigen::Vector2d ab = camera->FitLine();
    const double B = b_s * b_s / (ab[1] + b_s), b_L0 = b_s - B;
    add(b_L0 / (1 - ab[0] * B / b_s), b_L0, B);
  }
  if (const auto& f_L = problem.given[kFocal]) {
    // The same line with f_L known: B (T - b_s (1/f_L - 1/z)) = b_s (1 - b_s / f_L + b_s / z).
    const Eigen::VectorXd inverse_z = camera->line.col(1);
    const Eigen::VectorXd row = camera->T.array() - b_s * (1 / *f_L - inverse_z.array());
    const Eigen::VectorXd value = b_s * (1 - b_s / *f_L + b_s * inverse_z.array());
    const double B = RobustLeastSquares(
        camera->weight.cwiseProduct(row), camera->weight.cwiseProduct(value), kMedians)(0);
    add(*f_L, b_s - B, B);
  }
  return candidates;
}

std::vector<StartCandidate> StartPlenopticPupil(const CameraModel& pinhole,
                                                const StartProblem& problem) {
  std::vector<StartCandidate> candidates;
  const auto add = [&](std::vector<double> params, double b_P) {
    params.push_back(problem.given[kCount].value_or(b_P));
    candidates.push_back({std::move(params)});
  };
  // A pupil in the thin lens may be near enough.
  for (const StartCandidate& thin : StartPlenoptic(pinhole, problem))
    add(thin.params, thin.params[kMlaDistance]);
  const auto camera = CalibrateVirtualImage(pinhole, problem);
  const auto& f_L = problem.given[kFocal];
  if (!camera || !f_L) return candidates;
  const double f = *f_L, F = camera->focal;
  const Eigen::Vector2d ab = camera->FitLine();
  const double K = F * (1 - 1 / ab[0]) / (f - F);
  const double e = K * ab[0] * f * f / (ab[1] * (1 + K));  // f_L - b_L0
  std::vector<double> params = camera->params;
  params[kFocal] = f;
  params[kMlaDistance] = problem.given[kMlaDistance].value_or(f - e);
  params[kSensorDistance] = problem.given[kSensorDistance].value_or(e * F / (ab[0] * f));
  if (params[kMlaDistance] > 0 && params[kSensorDistance] > 0 && K * e > 0) add(params, K * e);
  return candidates;
}

std::vector<StartCandidate> StartPlenopticThick(const CameraModel& pinhole,
                                                const StartProblem& problem) {
  const auto& given = problem.given[kCount];
  std::vector<StartCandidate> candidates = StartPlenoptic(pinhole, problem);
  for (StartCandidate& thin : candidates) {
    thin.params.push_back(given.value_or(1 / thin.params[kMlaDistance]));
  }
  const auto camera = given ? CalibrateVirtualImage(pinhole, problem) : std::nullopt;
  if (!camera) return candidates;
  // The equations of `StartPlenopticPupil` for e, f_L and B; F^2 = b B (1 + B w_P).
  const double F = camera->focal, w_P = *given;
  const Eigen::Vector2d ab = camera->FitLine();
  const double B = 2 * F * F / (ab[1] + std::sqrt(ab[1] * ab[1] + 4 * ab[1] * w_P * F * F));
  const double e = ab[0] * B / (1 + B * w_P * (1 - ab[0]));
  const double f_L = ab[1] * B * (1 + e * w_P) / F;
  std::vector<double> params = camera->params;
  params[kFocal] = problem.given[kFocal].value_or(f_L);
  params[kMlaDistance] = problem.given[kMlaDistance].value_or(params[kFocal] - e);
  params[kSensorDistance] = problem.given[kSensorDistance].value_or(B);
  params.push_back(w_P);
  if (std::ranges::all_of(params, [](double value) { return std::isfinite(value); })) {
    candidates.insert(candidates.begin(), {params});
  }
  return candidates;
}

}  // namespace plenocal
