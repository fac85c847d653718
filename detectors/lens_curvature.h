// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

namespace plenocal {

/// How a lens bends what is about one place p of its image, in what a homography cannot undo: of
/// what is at a distance d from p, in complex numbers, it shifts
///
///   b |d|^2 + c conj(d)^2 + k_0 |d|^2 d + k_1 e^2 conj(d)^2 d + k_2 conj(e)^2 d^3
///   + k_3 e^4 conj(d)^3,
///
/// e the direction of p. The bends are the parts of b and c and the real k: all terms to third
/// order that a lens with an axis of symmetry has. p and d are counted in halves of the image's
/// diagonal, p from its middle. No ray is needed, so that this holds for fisheyes too.
inline constexpr int kBends = 8;
using LensBends = Eigen::Matrix<double, kBends, 1>;

/// The direction e of a place.
Eigen::Vector2d BendDirection(const Eigen::Vector2d& p);

/// What a piece of an image says about the lens: the value of `along` . bends, near the bends that
/// were assumed.
struct LensReading {
  Eigen::Vector2d p;  ///< the place
  LensBends along;    ///< of length 1
  double value = 0;
  double variance = 0;  ///< of value, from the noise
};

/// How something measured among bent lines moves with the bends assumed about a place.
struct BentPiece {
  Eigen::Vector2d p;
  LensBends bends;                            ///< assumed
  Eigen::Matrix<double, 2, kBends> by_bends;  ///< px
};

/// A marker measured among bent lines.
struct BentMarker {
  std::vector<BentPiece> pieces;  ///< their shifts add up
  double sigma = 0;               ///< px, of each coordinate, were the bends exact
};

/// The bending that a lens does to straight lines, learned from its images. Few readings, or
/// uncertain ones, say little and leave it near 0.
///
/// The lens has an axis of symmetry through some p_0, so b is along q = p - p_0, c along q^3 and
/// the k are real, by functions of |q|^2. Those of a weak radial distortion q (A_0 |q|^2 + A_1
/// |q|^4 + ...) belong together; g_0 q^3 + g_1 |q|^2 q^3, h_1 |q|^2 and h_2 |q|^2 are what c, k_1
/// and k_2 have beside it, for a lens that is not weak. a is added to b, for elements that are not
/// centred.
class LensCurvature {
 public:
  explicit LensCurvature(std::span<const LensReading> readings);

  [[nodiscard]] LensBends At(const Eigen::Vector2d& p) const;

  /// Where the axis of symmetry is, in halves of the image's diagonal from its middle.
  [[nodiscard]] Eigen::Vector2d axis() const { return lens_.tail<2>(); }

  /// How far a marker moves with the bends that are known now, px.
  [[nodiscard]] Eigen::Vector2d Change(const BentMarker& bent) const;

  /// Sigma of each of its coordinates then, px.
  [[nodiscard]] double Sigma(const BentMarker& bent) const;

  /// Variance of `row` . bends about p.
  [[nodiscard]] double Variance(const Eigen::Vector2d& p, const LensBends& row) const;

 private:
  static constexpr int kRadialOrders = 5, kOtherOrders = 2, kOtherThirds = 2;
  static constexpr int kCoefficients = 2 + kRadialOrders + kOtherOrders + kOtherThirds;
  static constexpr int kUnknowns = kCoefficients + 2;
  using Lens = Eigen::Matrix<double, kUnknowns, 1>;  // a, A_n, g_n, h_n, p_0
  using ByCoefficients = Eigen::Matrix<double, kBends, kCoefficients>;
  using ByLens = Eigen::Matrix<double, kBends, kUnknowns>;

  /// The bends are linear in all but the axis.
  static ByCoefficients BendsByCoefficients(const Eigen::Vector2d& p, const Eigen::Vector2d& axis);
  [[nodiscard]] ByLens BendsByLens(const Eigen::Vector2d& p) const;

  Lens lens_ = Lens::Zero();
  Eigen::Matrix<double, kUnknowns, kUnknowns> covariance_ =
      Eigen::Matrix<double, kUnknowns, kUnknowns>::Zero();
};

}  // namespace plenocal
