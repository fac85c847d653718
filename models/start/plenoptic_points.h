// SPDX-License-Identifier: Apache-2.0
//
// The relation between the micro images of one point, for any camera (docs/plenoptic.md): x_R = u_0
// + s c_I with three numbers for all of them. Distortion bends this only by its change over the
// point's micro images, which lie close together.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/camera/camera_model.h"
#include "calib/camera/observation.h"

namespace plenocal {

/// Derivatives by T_1 to T_4 of the third-order displacement (models/start/plenoptic_model.h) at
/// the place d in the micro image around c.
inline Eigen::Matrix<double, 2, 4> ThirdOrderTerms(const Eigen::Vector2d& c,
                                                   const Eigen::Vector2d& d) {
  const double cd = c.dot(d), d2 = d.squaredNorm();
  Eigen::Matrix<double, 2, 4> terms;
  terms << d2 * d, 2 * cd * d + d2 * c, cd * c, c.squaredNorm() * d;
  return terms;
}

/// Weighted least-squares fit of (u_0, s) to the observations (x, y, lens_x, lens_y) of one marker
/// in one view. A single micro image, or several with one centre, leave no residual.
void FitMicroImages(std::span<const Observation* const> of_marker,
                    std::span<const double> weights,
                    ReplicateResidual* residuals);

/// `CameraModel::replicate_terms` of the same relation, unweighted: what it leaves of the points,
/// and of the third order about the principal point, px; none for a single micro image. The terms
/// are at the fitted places: noise of the measured ones would explain itself.
Eigen::MatrixXd ThirdOrderOfMicroImages(const Eigen::Vector2d& principal_point,
                                        std::span<const Observation* const> of_marker);

/// Sets Observation::lens_type to the micro lens' place in the three interleaved sets of a
/// hexagonal array, when the noise of these differs (an array of one type has none to separate).
/// Leaves it alone when the centres are no lattice.
void FindLensTypes(std::vector<View>* views);

/// `CameraModel::Remedy` for the parameters f_L, b_L0, B, c_x, c_y, A_0, A_1, B_0, B_1, for the
/// pupil's distance at the place `pupil` and two angles of the array from `tilt` on.
std::string PlenopticRemedy(std::span<const size_t> weak,
                            size_t pupil,
                            std::optional<size_t> tilt,
                            const DepthRange& seen);

}  // namespace plenocal
