// SPDX-License-Identifier: Apache-2.0
//
// The distortion of a lens, estimated from images of straight edges before any calibration.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

namespace plenocal {

/// Distortion about one place p of an image, without the part that a homography can undo: what is
/// at a distance d from p is displaced by (in complex numbers)
///
///   b |d|^2 + c conj(d)^2 + k_0 |d|^2 d + k_1 e^2 conj(d)^2 d + k_2 conj(e)^2 d^3
///   + k_3 e^4 conj(d)^3,
///
/// e the direction of p from the image's middle. The eight terms are the real and imaginary parts
/// of b and c and the real k_0 to k_3: all terms up to third order that a lens with an axis of
/// symmetry has. Unit of p and d: half of the image's diagonal; origin of p: the image's middle. No
/// ray is involved, so this holds for fisheye lenses too.
inline constexpr int kDistortionTerms = 8;
using LocalDistortion = Eigen::Matrix<double, kDistortionTerms, 1>;

/// The place of a pixel in that unit; `size`: width and height of the image, px.
inline Eigen::Vector2d PlaceOfPixel(const Eigen::Vector2d& pixel, const Eigen::Vector2d& size) {
  return (pixel - (size - Eigen::Vector2d::Ones()) / 2) / (size.norm() / 2);
}

/// The direction e of a place; x in the middle of the image, which has none.
Eigen::Vector2d RadialDirection(const Eigen::Vector2d& p);

/// A measurement of the local distortion in one direction of its terms: along . distortion = value.
struct DistortionMeasurement {
  Eigen::Vector2d p;      ///< place
  LocalDistortion along;  ///< of length 1
  double value = 0;
  double variance = 0;  ///< of value, from the image noise
};

/// Dependence of a measured point on the local distortion that was assumed at one place.
struct SensitivityPiece {
  Eigen::Vector2d p;
  LocalDistortion assumed;
  Eigen::Matrix<double, 2, kDistortionTerms> by_distortion;  ///< derivatives of the point, px
};

/// Dependence of a measured marker on the distortion that was assumed.
struct DistortionSensitivity {
  std::vector<SensitivityPiece> pieces;  ///< their displacements add up
  /// px, of each coordinate if the distortion were exact; contains its orders above the third
  double sigma = 0;
};

/// Distortion over the whole image, fitted to measurements. It stays near 0 where these are few or
/// uncertain.
///
/// The lens has an axis of symmetry through some p_0. With q = p - p_0, b is along q, c along q^3,
/// and the k are real functions of |q|^2. The part that is a radial distortion
/// q (A_0 |q|^2 + A_1 |q|^4 + ...) has common coefficients A_n; a strong lens adds
/// g_0 q^3 + g_1 |q|^2 q^3 to c, h_1 |q|^2 to k_1 and h_2 |q|^2 to k_2; a decentred one adds a
/// constant a to b.
class DistortionField {
 public:
  explicit DistortionField(std::span<const DistortionMeasurement> measurements);

  [[nodiscard]] LocalDistortion At(const Eigen::Vector2d& p) const;

  /// p_0, in halves of the image's diagonal from the middle.
  [[nodiscard]] Eigen::Vector2d axis() const { return coefficients_.tail<2>(); }

  /// Displacement of a marker when the distortion assumed is replaced by this field, px.
  [[nodiscard]] Eigen::Vector2d Change(const DistortionSensitivity& sensitivity) const;

  /// Displacement of the marker at `p` by orders above the third, px: estimated from the change of
  /// the distortion between the marker and the places where it was assumed.
  [[nodiscard]] Eigen::Vector2d HigherOrders(const DistortionSensitivity& sensitivity,
                                             const Eigen::Vector2d& p) const;

  /// Sigma of each coordinate of the marker then, px.
  [[nodiscard]] double Sigma(const DistortionSensitivity& sensitivity) const;

 private:
  static constexpr int kRadialOrders = 5, kOtherOrders = 2, kOtherThirds = 2;
  static constexpr int kLinear = 2 + kRadialOrders + kOtherOrders + kOtherThirds;
  static constexpr int kCoefficients = kLinear + 2;
  using Coefficients = Eigen::Matrix<double, kCoefficients, 1>;  // a, A_n, g_n, h_n, p_0
  using Covariance = Eigen::Matrix<double, kCoefficients, kCoefficients>;
  using TermsByLinear = Eigen::Matrix<double, kDistortionTerms, kLinear>;
  using TermsByAll = Eigen::Matrix<double, kDistortionTerms, kCoefficients>;
  struct NormalEquations;

  /// The terms are linear in all coefficients but the axis.
  static TermsByLinear LinearJacobian(const Eigen::Vector2d& p, const Eigen::Vector2d& axis);
  [[nodiscard]] TermsByAll Jacobian(const Eigen::Vector2d& p) const;
  [[nodiscard]] NormalEquations Linearise(std::span<const DistortionMeasurement> measurements,
                                          const std::vector<double>& residuals,
                                          double scale) const;
  /// Residuals in standard deviations of the measurements.
  [[nodiscard]] std::vector<double> Residuals(
      std::span<const DistortionMeasurement> measurements) const;

  Coefficients coefficients_ = Coefficients::Zero();
  Covariance covariance_ = Covariance::Zero();
};

}  // namespace plenocal
