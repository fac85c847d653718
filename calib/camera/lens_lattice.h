// SPDX-License-Identifier: Apache-2.0
//
// A lattice of micro lenses, hexagonal or rectangular, as an image shows it. The lattice itself is
// regular; lens distortion, which is smooth, bends its image. So a node's place is a low-order
// polynomial of its lattice coordinates.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <span>
#include <vector>

#include "calib/camera/observation.h"

namespace plenocal {

/// A node of a lattice.
struct LatticeNode {
  int column = 0, row = 0;
  auto operator<=>(const LatticeNode&) const = default;  // NOLINT(modernize-use-nullptr)
};

/// Arrangement of the nodes. The canonical basis of a hexagonal lattice spans 60 degrees, that of a
/// rectangular (or square) one 90.
enum class LatticeKind { kHexagonal, kRectangular };

/// The arrangement that a canonical basis spans.
LatticeKind KindOfLattice(const Eigen::Matrix2d& basis);

/// Steps to the nodes around a node: six, or eight with those across the corners.
std::span<const LatticeNode> LatticeNeighbours(LatticeKind kind);

/// A division of a lattice into interleaved sets of nodes, in which types of micro lenses repeat:
/// the nodes (column + columns, row) and (column + shift, row + rows) are of the set of (column,
/// row). With 0 <= shift < columns each periodic division has one such form.
struct LensPattern {
  int columns = 1, rows = 1, shift = 0;

  [[nodiscard]] constexpr int Sets() const { return columns * rows; }
  /// 0 .. Sets() - 1.
  [[nodiscard]] int Set(const LatticeNode& node) const;
};

/// The one way to divide a hexagonal lattice into three sets such that neighbours differ.
inline constexpr LensPattern kThreeInterleaved{.columns = 3, .rows = 1, .shift = 1};

/// All patterns of so many sets.
std::vector<LensPattern> LensPatterns(int sets);

/// The vectors to the next node of a row (nearest to the x axis) and to the next row (60 or 90
/// degrees on, from x to y) as columns, of the lattice that two vectors to neighbours span.
Eigen::Matrix2d CanonicalLatticeBasis(const Eigen::Matrix2d& basis);

/// The canonical basis around the middle of points in a lattice; nothing when no point there has
/// neighbours on all sides.
std::optional<Eigen::Matrix2d> FindLatticeBasis(std::span<const Eigen::Vector2d> points,
                                                ImageSize image_size);

/// The node of each point. Nodes grow from the point nearest to the middle of the image outward;
/// each is predicted from its neighbours, so the lattice may bend. Points that fit nowhere get
/// nothing.
std::vector<std::optional<LatticeNode>> IndexLattice(std::span<const Eigen::Vector2d> points,
                                                     const Eigen::Matrix2d& basis,
                                                     ImageSize image_size);

/// A measured node.
struct LatticeMeasurement {
  LatticeNode node;
  Eigen::Vector2d position{0, 0};  ///< px
  double sigma = 1;                ///< relative to others, any unit
};

/// Places of nodes as a polynomial of the lattice coordinates.
class SmoothLattice {
 public:
  static constexpr int kMaxDegree = 7;
  /// Width of Tukey's biweight in standard deviations: 95 % efficiency for normal errors, for the
  /// length of 2D residuals.
  static constexpr double kTukeyWidth = 6.0;
  /// Number of monomials of two coordinates up to a degree.
  static constexpr int CountMonomials(int degree) { return (degree + 1) * (degree + 2) / 2; }
  /// They at a place, by degree, at most `kMaxDegree`.
  static Eigen::VectorXd Monomials(const Eigen::Vector2d& place, int degree);

  /// Robust fit (Tukey's biweight). The degree, 1 to 7 (that of a radial distortion with three
  /// terms), is chosen by the Bayesian information criterion. Throws
  /// `Error` of kind kJob for fewer than 6 measurements.
  static SmoothLattice Fit(std::span<const LatticeMeasurement> measurements);

  [[nodiscard]] Eigen::Vector2d Position(double column, double row) const;
  /// Derivative of Position by (column, row).
  [[nodiscard]] Eigen::Matrix2d Basis(double column, double row) const;
  /// Second derivatives of the two coordinates of Position by (column, row).
  [[nodiscard]] std::array<Eigen::Matrix2d, 2> SecondDerivatives(double column, double row) const;
  /// The lattice coordinates at a place in the image.
  [[nodiscard]] Eigen::Vector2d Coordinates(const Eigen::Vector2d& position) const;
  /// The `measured` nodes and all within the image and `margin` px around it that continue them,
  /// sorted by row and column. Throws `Error` of kind kJob for more than four times as many as
  /// cells of `cell` px^2 fill that area: nodes of one row leave the other lattice vector open.
  [[nodiscard]] std::vector<LatticeNode> NodesInside(std::span<const LatticeMeasurement> measured,
                                                     ImageSize image_size,
                                                     double margin,
                                                     double cell) const;
  [[nodiscard]] int Degree() const { return degree_; }
  /// Robust standard deviation per coordinate of a measurement of sigma 1 about the lattice.
  [[nodiscard]] double Sigma() const { return sigma_; }

 private:
  [[nodiscard]] Eigen::VectorXd TermsAt(const Eigen::Vector2d& coordinates, int degree) const {
    return Monomials((coordinates - middle_) / scale_, degree);
  }

  int degree_ = 1;
  double sigma_ = 0;
  Eigen::Vector2d middle_{0, 0};  // lattice coordinates are shifted and scaled to [-1, 1]
  double scale_ = 1;
  Eigen::Matrix2Xd coefficients_;  // one column a monomial
};

/// True for a position on the sensor, within the area of its pixels, or at most `margin` px beside
/// it.
bool IsInside(const Eigen::Vector2d& position, ImageSize image_size, double margin = 0);

}  // namespace plenocal
