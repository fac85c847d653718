// SPDX-License-Identifier: Apache-2.0
//
// The image of a plane by any lens, as a smooth map that needs no camera model.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace plenocal {

/// (P(X) / D(X), Q(X) / D(X)) with polynomials P and Q of order 1 to 3 and a linear D: a homography
/// with the distortion that a lens adds over one view. Order 1 is the homography itself.
class PlaneMap {
 public:
  /// Pairs of a point on the plane (any unit) and its image.
  struct Pairs {
    std::vector<Eigen::Vector2d> plane, image;
    std::vector<double> scale;  ///< px of the measured image per unit of `image`

    void Add(const Eigen::Vector2d& on_plane, const Eigen::Vector2d& in_image, double px) {
      plane.push_back(on_plane);
      image.push_back(in_image);
      scale.push_back(px);
    }
  };

  /// By weighted least squares. Nothing when there are too few pairs or they lie on a line.
  static std::optional<PlaneMap> Fit(const Pairs& pairs,
                                     const std::vector<double>& weights,
                                     int order);
  /// Order by order, with Cauchy's weights at the scatter of the residuals.
  static std::optional<PlaneMap> FitRobustly(const Pairs& pairs, int order);

  /// The order that so many points determine with twice as many equations as unknowns or more.
  static int OrderFor(size_t points);
  /// Unknowns of a map.
  static int Unknowns(int order);

  /// In units of `image`; infinite beyond the line that D maps to infinity.
  [[nodiscard]] Eigen::Vector2d operator()(const Eigen::Vector2d& plane) const;
  /// Lengths of the residuals, px.
  [[nodiscard]] std::vector<double> Lengths(const Pairs& pairs) const;

 private:
  int order_ = 1;
  Eigen::Vector2d plane_middle_, image_middle_;
  double plane_scale_ = 1, image_scale_ = 1;
  Eigen::VectorXd coefficients_;  // of P, of Q, of D without its constant 1
};

}  // namespace plenocal
