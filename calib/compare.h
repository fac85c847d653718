// SPDX-License-Identifier: Apache-2.0
//
// How far two calibrations of one camera differ in the image.
#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "calib/calibration_file.h"

namespace plenocal {

/// A part of the image at one distance.
struct ImageDifference {
  int points = 0;        ///< sampled pixels that both calibrations image
  double rms = 0;        ///< of the differences' lengths, px
  double largest = 0;    ///< px
  double predicted = 0;  ///< rms that the covariances of both predict, px; infinite when open
  /// Probability of a larger rms by the predicted errors alone; 1 without points.
  double probability = 1;
  bool differs = false;  ///< by more than the prediction explains
};

/// A pixel of the grid that is compared.
struct PixelDifference {
  Eigen::Vector2d u_px;           ///< in a's image
  Eigen::Vector2d difference_px;  ///< b's image of what a sees there, less `u_px`
};

/// Differences of all the image and of its 3 x 3 parts, row by row.
struct DistanceDifference {
  double distance = 0;  ///< m, infinite for far away
  ImageDifference all;
  std::array<ImageDifference, 9> parts;
  std::vector<PixelDifference> pixels;  ///< those that both image
};

/// The grid of `PixelDifference`: its cells over the image; a pixel is the middle of its own.
inline constexpr int kComparedColumns = 30, kComparedRows = 20;

struct CameraDifference {
  std::string name;
  /// The motion of the camera's frame that the difference of the intrinsics implies: poses of the
  /// target follow it, so that it is no difference of what is seen. p_b = T_b_a p_a.
  RigidTransform T_b_a;
  /// Its derivatives by the parameters of a and of b, in the chart of `Retract`: six rows.
  Eigen::MatrixXd T_b_a_by_a, T_b_a_by_b;
  std::vector<DistanceDifference> distances;
  /// Whether both files have sigmas, and all of them finite.
  bool has_prediction = false;
  /// No part of the image at any distance differs by more than the sigmas explain, with a false
  /// alarm in a hundred comparisons.
  bool same = false;
};

/// Pixels of a grid over a's image are taken out along their rays to each distance, moved by the
/// T_b_a that makes the sum of squared differences smallest, each in the sigma that both
/// covariances give it, and projected by b. The prediction is linear: covariances of both
/// calibrations, less what a change of T_b_a takes up. The mean square difference is compared with
/// its distribution under the prediction, a weighted sum of squares, by its first two moments
/// (Satterthwaite 1946). Throws `Error` when the two cannot be compared.
CameraDifference CompareCameras(const CalibratedCamera& a,
                                const CalibratedCamera& b,
                                const std::vector<double>& distances);

/// A camera in both calibrations, compared.
struct Counterparts {
  const CalibratedCamera& a;
  const CalibratedCamera& b;
  const CameraDifference& difference;
};

/// How two calibrations of a rig differ in a camera's place relative to another camera.
struct MountDifference {
  double turn = 0, shift = 0;              ///< rad, m
  double turn_sigma = 0, shift_sigma = 0;  ///< what the covariances of both predict (RMS)
  bool has_prediction = false;             ///< sigmas are there and finite
  double probability = 1;                  ///< of a larger difference by these errors alone
  bool differs = false;                    ///< probability below one in a hundred
};

/// The place of `camera` in the frame of `master`, which the calibrations may have on the rig as
/// they like, once the frames of both have moved as their intrinsics imply. The prediction is
/// linear, with the correlations between parameters and places that both files have: images leave
/// a camera's axis and its principal point open together, so that places alone are far less certain
/// than what is compared here. The difference is tested by chi-square.
MountDifference CompareMounts(const Counterparts& master,
                              const Counterparts& camera,
                              const Correlations& of_a,
                              const Correlations& of_b);

/// What its covariance predicts of a camera's image at these distances, each with equal weight, px:
/// RMS over the image of the sigma of a point's place, less what a motion of the camera's frame
/// takes up. Infinite when a parameter is not determined. Throws `Error` when it images nothing.
double ImageSigma(const CalibratedCamera& camera, const std::vector<double>& distances);

}  // namespace plenocal
