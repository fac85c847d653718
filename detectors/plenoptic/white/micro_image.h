// SPDX-License-Identifier: Apache-2.0
//
// Model of one micro image of a uniform field: a radial profile P, common to all micro lenses of a
// type, times a brightness that changes linearly over the micro image:
//
//   I(x) = P(|u| / s) (g + h . (x - c))
//
// with u = x - c without lens distortion, of which it contains the first two orders about c. c, g,
// h and the size s belong to the micro image. The gradient h displaces a centroid, but not this
// fit. Micro images overlap at their edges, where their light adds up; so a fit uses the pixels
// less the light of all other micro images.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <span>
#include <vector>

namespace plenocal::internal {

/// A radial function as a cubic B-spline in r, even about r = 0.
class RadialProfile {
 public:
  /// A profile for r in [0, radius], px; zero at first.
  explicit RadialProfile(double radius);

  struct Value {
    double value = 0, slope = 0;
  };
  [[nodiscard]] Value At(double r) const;
  [[nodiscard]] double Radius() const { return radius_; }
  /// Of each cell between knots, which are half a pixel apart, the coefficients of the cubic:
  /// powers 0 .. 3 of the distance from the cell's first knot, in cells.
  [[nodiscard]] const std::vector<Eigen::Vector4d>& Cells() const { return cells_; }
  /// Divides by the highest value and returns that.
  double Normalise();

 private:
  friend class ProfileFit;
  double radius_;
  std::vector<Eigen::Vector4d> cells_;
};

/// Distortion about a micro-image centre: an offset u, px of the image's middle, by x - c, px. The
/// columns belong to x, y, x^2, x y, y^2.
using LocalMap = Eigen::Matrix<double, 2, 5>;

/// One micro image, measured.
struct MicroImage {
  Eigen::Vector2d centre{0, 0};         ///< px
  double gain = 0;                      ///< grey values: brightness at the centre where P = 1
  Eigen::Vector2d gradient{0, 0};       ///< grey values per px
  double scale = 1;                     ///< size relative to the others of its type
  LocalMap map = LocalMap::Identity();  ///< is not measured
  double residual = 0;                  ///< root mean square of the fit's residuals, grey values
  double centre_sigma = 0;              ///< px, for noise of one grey value; 0 when the fit failed
};

/// A white image and the modelled light of all micro images in it (both CV_32F).
struct ModelledImage {
  cv::Mat white, light;
};

/// Adds the light of a micro image to `light` (CV_32F).
void AddLight(const RadialProfile& profile, const MicroImage& image, cv::Mat* light);

/// u of an offset d = x - c, px.
inline Eigen::Vector2d Undistorted(const LocalMap& map, const Eigen::Vector2d& d) {
  return map * Eigen::Vector<double, 5>(d.x(), d.y(), d.x() * d.x(), d.x() * d.y(), d.y() * d.y());
}

/// Part of a micro image in a pixel: P_type(r) brightness, r = |u| / s.
struct Contribution {
  int type = 0;
  double r = 0;           ///< px
  double brightness = 0;  ///< g + h . d
};

/// Fits the profiles of all types at once to pixels that several micro images share (linear least
/// squares).
class ProfileFit {
 public:
  ProfileFit(double radius, int types);
  /// A pixel as the sum of contributions; those beyond the radius are zero.
  void Add(double pixel, double weight, std::span<const Contribution> parts);
  void Add(const ProfileFit& other);
  /// The profiles, not yet scaled to a highest value of 1.
  [[nodiscard]] std::vector<RadialProfile> Solve() const;

 private:
  double radius_;
  int types_;
  Eigen::MatrixXd normal_;
  Eigen::VectorXd right_;
};

/// Fits centre, gain, gradient and size (Gauss-Newton) to the pixels within `radius` of
/// `start.centre`. The modelled light includes this micro image as `start`.
MicroImage FitMicroImage(const ModelledImage& scene,
                         const RadialProfile& profile,
                         double radius,
                         const MicroImage& start);

/// Mean of (pixel - modelled light) / gain in `rings` rings of equal width within `radius` of the
/// centre.
Eigen::VectorXd RingResiduals(const ModelledImage& scene,
                              const MicroImage& image,
                              double radius,
                              int rings);

}  // namespace plenocal::internal
