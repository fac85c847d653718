// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

namespace plenocal {

/// How an edge that is straight on the target is bent in the image: by `bend` d^2 (px) in the
/// direction `normal` at a distance d (px) along it from `place`.
struct BentEdge {
  Eigen::Vector2d place;   ///< px
  Eigen::Vector2d normal;  ///< of length 1
  double bend = 0;         ///< 1/px
  double variance = 0;     ///< of bend, from the noise
};

/// How a marker, measured among bent edges, moves with the lens' curvature assumed for them.
struct BentMarker {
  Eigen::Vector2d place;            ///< px, that the curvature belongs to
  Eigen::Vector2d curvature;        ///< assumed, 1/px
  Eigen::Matrix2d by_curvature;     ///< px^2
  double growth = 0;                ///< of the curvature with the distance, assumed, 1/px^2
  Eigen::Vector2d by_growth{0, 0};  ///< px^3
};

/// The curvature that a lens gives to straight lines, learned from the edges in its images.
///
/// To second order a lens' distortion is a homography and a shift c |d|^2, d being the distance
/// from the place p. Of third-order radial and tangential distortion c = k (p - p_0) exactly;
/// of radial distortion of any order it is p times a function of |p|^2 about the image's middle, if
/// that is where the lens' axis is. Hence c = a + k p + l p |p|^2, with normal coefficients whose
/// variance is the edges'. Few edges, or uncertain ones, say little and leave c near 0. To third
/// order the shift is (c + g d) |d|^2 with c's growth g, of third-order radial distortion k.
class LensCurvature {
 public:
  /// `size`: width and height of the image, px.
  LensCurvature(std::span<const BentEdge> edges, const Eigen::Vector2d& size);

  /// c at a place, 1/px.
  [[nodiscard]] Eigen::Vector2d At(const Eigen::Vector2d& place) const;

  /// g at a place, 1/px^2: the mean derivative of c.
  [[nodiscard]] double Growth(const Eigen::Vector2d& place) const;

  /// How far a marker moves with the curvature and growth that are known now, px.
  [[nodiscard]] Eigen::Vector2d Change(const BentMarker& bent) const;

  /// Variance of an edge's true bend about the one that follows from `At`.
  [[nodiscard]] double Variance(const Eigen::Vector2d& place, const Eigen::Vector2d& normal) const;

 private:
  /// Of n . c by a, k and l.
  [[nodiscard]] Eigen::Vector4d Row(const Eigen::Vector2d& place,
                                    const Eigen::Vector2d& normal) const;

  Eigen::Vector2d middle_;
  double radius_ = 1;  ///< px, half the image's diagonal
  Eigen::Vector4d coefficients_;
  Eigen::Matrix4d covariance_;
  double rest_ = 0;  ///< variance of edges' bends about a smooth c
};

}  // namespace plenocal
