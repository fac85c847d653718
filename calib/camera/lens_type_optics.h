// SPDX-License-Identifier: Apache-2.0
//
// Focal length, aperture and depth of field of the lens types of a micro-lens array, from the blur
// of markers (docs/plenoptic.md, "Lens types").
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

namespace plenocal {

/// Blur of markers of about one virtual depth in one raw image, seen by micro lenses of one type.
struct BlurMeasurement {
  int lens_type = 0;
  double inverse_depth = 0;     ///< 1 / v, virtual depth by micro-image centres
  double blur = 0;              ///< standard deviation of a Gaussian, px; pixel and sensor included
  double sigma = 0;             ///< standard error of `blur`, px
  Eigen::Vector2d place{0, 0};  ///< mean micro-image centre, px
};

/// b_P of w_P = 1 / b_P, m; that of a telecentric lens is finite, beyond any array's means.
inline double PupilDistance(double w_P) { return 1 / (w_P == 0 ? 1e-9 : w_P); }

/// Distances behind the main lens, m, and the size of a pixel, m.
struct MicroLensGeometry {
  double f_L = 0, b_L0 = 0, B = 0;
  double b_P = 0;  ///< exit pupil to micro lenses; of a thin lens b_L0
  double pixel_size = 0;
  double sigma_B = 0;  ///< standard error of B, the least certain of them
  Eigen::Vector2d tilt{0, 0}, principal_point{0, 0};  ///< of the array, rad; px
};

/// Optics of the micro lenses of one type.
struct LensTypeOptics {
  int lens_type = 0;
  double focal_length = 0, focal_length_sigma = 0;  ///< m
  double aperture = 0, aperture_sigma = 0;          ///< diameter, m
  double in_focus = 0;  ///< distance along the optical axis, m; infinite: beyond infinity
  /// Distances between which the aperture blurs by a disc of at most one pixel in diameter, m; 0:
  /// up to the main lens, infinite: to infinity.
  double near = 0, far = 0;
};

/// The lens types whose focal length is known to 10 %, by number. Empty where the blur does not
/// change significantly (3 sigma) with depth, or no marker was in focus of any type.
std::vector<LensTypeOptics> EstimateLensTypes(std::span<const BlurMeasurement> measurements,
                                              const MicroLensGeometry& geometry);

/// Diameter, px, of the disc by which the aperture of a lens type blurs a point at the distance z_C
/// (m).
double BlurDisc(const LensTypeOptics& type, const MicroLensGeometry& geometry, double z_C);

}  // namespace plenocal
