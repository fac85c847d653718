// SPDX-License-Identifier: Apache-2.0
#include "calib/camera/lens_type_optics.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "calib/base/linear_algebra.h"
#include "calib/base/robust.h"

namespace plenocal {
namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();
/// A disc's standard deviation along each axis is a quarter of its diameter.
constexpr double kDiameters = 4;

/// 1 / v_P, v_P being the paper's virtual depth, from 1 / v, the depth that detection measures:
/// 1 - 1 / v = g (1 - 1 / v_P).
double PaperInverseDepth(const MicroLensGeometry& geometry, double inverse_depth) {
  return 1 - (1 - inverse_depth) * (geometry.b_P + geometry.B) / geometry.b_P;
}

/// Distance of the point whose virtual image has the inverse virtual depth w (the paper's), m.
double DistanceAt(const MicroLensGeometry& geometry, double w) {
  const double f_L = geometry.f_L, b_L0 = geometry.b_L0, B = geometry.B;
  const double beyond = B - w * (f_L - b_L0);
  return beyond > 0 ? std::max(0.0, f_L * (B + w * b_L0) / beyond) : kInfinite;
}

/// The standard deviation of the Gaussian whose blurred edge fits best, by least squares, that of a
/// Gaussian of variance c convolved with a disc of variance s along each axis, squared: c + s where
/// the disc is small, c + 1.18 s where it is all, since a disc has no tails. The form between them
/// is fitted to the numerical solution, to 0.2 % of s.
struct FittedSquare {
  double value, by_c, by_s;

  FittedSquare(double c, double s) {
    constexpr double kExcess = 0.18, kTurn = 1.34;  // of s; s / c at half of the excess
    const double sum = s + kTurn * c;
    value = c + s * (1 + kExcess * s / sum);
    by_c = 1 - kExcess * kTurn * s * s / (sum * sum);
    by_s = 1 + kExcess * s * (sum + kTurn * c) / (sum * sum);
  }
};

/// Blur by z = 1 / v: that of the sensor, of variance c, which all lens types share as they share
/// their aperture, and the aperture's disc out of focus, of variance s = K (B_i / B (z - z_t))^2.
class BlurModel {
 public:
  /// `B_ratio`: B_i / B, where a tilt makes that of measurement i another.
  /// REQUIRES: each lens type has three measurements or more.
  BlurModel(std::span<const BlurMeasurement> measurements, Eigen::VectorXd B_ratio)
      : measurements_(measurements),
        B_ratio_(std::move(B_ratio)),
        square_(static_cast<Eigen::Index>(measurements.size())),
        precision_(square_.size()) {
    for (const BlurMeasurement& m : measurements) focus_.emplace(m.lens_type, 0);
    Eigen::Index next = kFocus;
    for (auto& [type, place] : focus_) place = next++;
    p_ = Eigen::VectorXd::Zero(next);
    for (Eigen::Index i = 0; i < square_.size(); ++i) {
      const BlurMeasurement& m = measurements[static_cast<size_t>(i)];
      square_[i] = m.blur * m.blur;
      precision_[i] = 1 / (2 * m.blur * m.sigma);
    }
    Start();
    Solve();
  }

  /// True when markers were in focus of some lens type. Where all are on one side, the parabola's
  /// width and height imitate each other: the sensor's blur and the aperture are unknown.
  [[nodiscard]] bool HasFocusInRange() const {
    return std::ranges::any_of(focus_, [&](const auto& type_and_place) {
      const auto& [type, place] = type_and_place;
      double low = kInfinite, high = -kInfinite;
      for (const BlurMeasurement& m : measurements_) {
        if (m.lens_type != type) continue;
        low = std::min(low, m.inverse_depth);
        high = std::max(high, m.inverse_depth);
      }
      return p_[place] > low && p_[place] < high;
    });
  }
  [[nodiscard]] const std::map<int, Eigen::Index>& Places() const { return focus_; }
  [[nodiscard]] double K() const { return p_[kK]; }
  /// z in focus.
  [[nodiscard]] double Focus(Eigen::Index place) const { return p_[place]; }
  [[nodiscard]] double Sigma(Eigen::Index place) const {
    return std::sqrt(covariance_(place, place));
  }

  static constexpr Eigen::Index kK = 0;

 private:
  static constexpr Eigen::Index kSquare = 1, kFocus = 2;

  [[nodiscard]] const BlurMeasurement& At(Eigen::Index i) const {
    return measurements_[static_cast<size_t>(i)];
  }
  [[nodiscard]] Eigen::VectorXd Weighted(const Eigen::VectorXd& values) const {
    return precision_.cwiseProduct(values);
  }

  /// K from blur^2 = K z^2 + slope_t z + offset_t, which is linear; z_t = -slope_t / (2 K).
  void Start() {
    const auto types = static_cast<Eigen::Index>(focus_.size());
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(square_.size(), 1 + 2 * types);
    for (Eigen::Index i = 0; i < square_.size(); ++i) {
      const double z = At(i).inverse_depth;
      const Eigen::Index type = focus_.at(At(i).lens_type) - kFocus;
      A(i, 0) = z * z;
      A(i, 1 + 2 * type) = z;
      A(i, 2 + 2 * type) = 1;
    }
    const Eigen::VectorXd linear =
        LeastSquares(Eigen::MatrixXd(precision_.asDiagonal() * A), Weighted(square_));
    p_[kK] = linear[0];
    for (Eigen::Index type = 0; type < types; ++type) {
      const double z = -linear[1 + 2 * type] / (2 * p_[kK]);
      p_[kFocus + type] = z;
      p_[kSquare] += (linear[2 + 2 * type] - p_[kK] * z * z) / static_cast<double>(types);
    }
  }

  /// Gauss-Newton steps with Cauchy weights.
  void Solve() {
    constexpr int kSteps = 30;
    Eigen::VectorXd weights = Eigen::VectorXd::Ones(square_.size());
    Eigen::MatrixXd information;
    double variance = 1;  // of a weighted residual
    for (int step = 0; step < kSteps; ++step) {
      Eigen::MatrixXd J = Eigen::MatrixXd::Zero(square_.size(), p_.size());
      Eigen::VectorXd residuals(square_.size());
      for (Eigen::Index i = 0; i < square_.size(); ++i) {
        const Eigen::Index place = focus_.at(At(i).lens_type);
        const double off = B_ratio_[i] * (At(i).inverse_depth - p_[place]);
        const FittedSquare fitted(p_[kSquare], p_[kK] * off * off);
        J(i, kK) = fitted.by_s * off * off;
        J(i, kSquare) = fitted.by_c;
        J(i, place) = -2 * fitted.by_s * p_[kK] * off * B_ratio_[i];
        residuals[i] = square_[i] - fitted.value;
      }
      J = precision_.asDiagonal() * J;
      residuals = Weighted(residuals);
      const Eigen::ArrayXd squares = residuals.array().square();
      // Errors that the markers of an image share are not in the standard errors of their blurs, so
      // that the scatter about the model counts where it is larger.
      const double freedom = static_cast<double>(square_.size() - p_.size()) * weights.mean();
      variance = std::max(1.0, (squares * weights.array()).sum() / std::max(1.0, freedom));
      weights = (squares / (variance * kCauchyWidthSquared<>)).unaryExpr(&CauchyWeight<double>);
      information = J.transpose() * weights.asDiagonal() * J;
      p_ += SolveSymmetric(information,
                           Eigen::VectorXd(J.transpose() * weights.cwiseProduct(residuals)));
    }
    covariance_ = variance * Inverse(information);
  }

  std::span<const BlurMeasurement> measurements_;
  Eigen::VectorXd B_ratio_, square_, precision_;  ///< the latter of the blurs
  std::map<int, Eigen::Index> focus_;             ///< by lens type: place of z_t among the unknowns
  Eigen::VectorXd p_;                             ///< K, c, then z_t of each type
  Eigen::MatrixXd covariance_;
};

/// B at the measurements over that of the middle of the array.
Eigen::VectorXd RatiosOfB(std::span<const BlurMeasurement> measurements,
                          const MicroLensGeometry& geometry) {
  const double g = geometry.b_P / (geometry.b_P + geometry.B);
  Eigen::VectorXd ratios(std::ssize(measurements));
  for (Eigen::Index i = 0; i < ratios.size(); ++i) {
    const Eigen::Vector2d c_ML =
        g * geometry.pixel_size *
        (measurements[static_cast<size_t>(i)].place - geometry.principal_point);
    ratios[i] = 1 + geometry.tilt.dot(c_ML) / geometry.B;
  }
  return ratios;
}

}  // namespace

std::vector<LensTypeOptics> EstimateLensTypes(std::span<const BlurMeasurement> measurements,
                                              const MicroLensGeometry& geometry) {
  std::map<int, int> points;
  for (const BlurMeasurement& m : measurements) ++points[m.lens_type];
  constexpr int kFewest = 5;  // of each type, more than its unknowns
  if (points.empty() ||
      std::ranges::any_of(points, [](const auto& of_type) { return of_type.second < kFewest; })) {
    return {};
  }
  // Where B is larger, the z in focus is 1 - (1 - z_t) B_i / B: with (1 - z) B / B_i in place of
  // 1 - z it is that of the middle.
  const Eigen::VectorXd B_ratio = RatiosOfB(measurements, geometry);
  std::vector<BlurMeasurement> in_middle(measurements.begin(), measurements.end());
  for (size_t i = 0; i < in_middle.size(); ++i) {
    double& z = in_middle[i].inverse_depth;
    z = 1 - (1 - z) / B_ratio[static_cast<Eigen::Index>(i)];
  }
  const BlurModel blur(in_middle, B_ratio);
  constexpr double kSure = 3;  // standard errors
  if (!(blur.K() > kSure * blur.Sigma(BlurModel::kK)) || !blur.HasFocusInRange()) return {};

  const double g = geometry.b_P / (geometry.b_P + geometry.B);
  // The blur that a fit finds is not quite that of the model: root mean square errors beyond the
  // scatter, over the five simulated sets of docs/plenoptic.md ("Lens types").
  constexpr double kFocalLengthError = 0.004, kApertureError = 0.04;
  // K = (aperture / (4 pixels g))^2.
  const double aperture = kDiameters * geometry.pixel_size * g * std::sqrt(blur.K());
  std::vector<LensTypeOptics> types;
  for (const auto& [lens_type, place] : blur.Places()) {
    const double z = blur.Focus(place), in_focus = PaperInverseDepth(geometry, z);
    // 1 / f = (1 - z_P) / B with 1 - z_P = (1 - z) / g.
    const double f = geometry.B * g / (1 - z);
    const double relative_sigma =
        std::hypot(blur.Sigma(place) / (1 - z), geometry.sigma_B / geometry.B, kFocalLengthError);
    constexpr double kUndetermined = 0.1;  // a type whose focus is far from all markers
    if (!(z < 1 && relative_sigma < kUndetermined)) continue;
    const double reach = geometry.pixel_size / aperture;  // of z_P, for a disc of one pixel
    const double one = DistanceAt(geometry, in_focus - reach);
    const double other = DistanceAt(geometry, in_focus + reach);
    types.push_back(
        {.lens_type = lens_type,
         .focal_length = f,
         .focal_length_sigma = f * relative_sigma,
         .aperture = aperture,
         .aperture_sigma =
             aperture * std::hypot(blur.Sigma(BlurModel::kK) / (2 * blur.K()), kApertureError),
         .in_focus = DistanceAt(geometry, in_focus),
         .near = std::min(one, other),
         .far = std::max(one, other)});
  }
  return types;
}

double BlurDisc(const LensTypeOptics& type, const MicroLensGeometry& geometry, double z_C) {
  const double w = geometry.B * (z_C - geometry.f_L) /
                   (geometry.f_L * z_C - geometry.b_L0 * (z_C - geometry.f_L));
  const double in_focus = 1 - geometry.B / type.focal_length;
  return type.aperture / geometry.pixel_size * std::abs(w - in_focus);
}

}  // namespace plenocal
