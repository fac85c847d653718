// SPDX-License-Identifier: Apache-2.0
//
// Difference between two calibrations of one camera in the image and of its extrinsics.
#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// A part of the image at one distance.
struct ImageDifference {
  int points = 0;        ///< sampled pixels that both calibrations image
  double rms = 0;        ///< of the differences' lengths, px
  double largest = 0;    ///< px
  double predicted = 0;  ///< rms that the covariances of both predict, px; infinite when open
  /// Probability of a larger rms by the predicted errors alone; 1 without points.
  double probability = 1;
  bool differs = false;  ///< by more than the prediction explains; of the whole image: a part does
};

/// A pixel of the grid that is compared.
struct PixelDifference {
  Eigen::Vector2d u_px;           ///< in a's image
  Eigen::Vector2d difference_px;  ///< image in b of the point that a images at `u_px`, less `u_px`
  double predicted_px = 0;        ///< RMS of its length that the covariances of both predict
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
  /// The rigid motion of the camera frame that compensates most of the difference of the
  /// intrinsics: poses of the target follow it, so it changes nothing in the images. p_b = T_b_a
  /// p_a.
  RigidTransform T_b_a;
  /// Its derivatives by the parameters of a and of b, in the chart of `Retract`: six rows.
  Eigen::MatrixXd T_b_a_by_a, T_b_a_by_b;
  std::vector<DistanceDifference> distances;
  /// Both files have standard errors, and all of them are finite.
  bool has_prediction = false;
  /// No part of the image at any distance differs by more than the standard errors explain, with
  /// one false alarm in a hundred comparisons.
  bool same = false;
};

/// Pixels of a grid over a's image are unprojected to each distance, moved by the T_b_a with the
/// smallest sum of squared differences (each weighted by its variance from both covariances), and
/// projected by b. The prediction is linear: covariances of both calibrations, less the part that a
/// change of T_b_a compensates. The mean square difference is compared with
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

/// Difference of the pose of one camera relative to another between two calibrations of a rig.
struct ExtrinsicsDifference {
  double rotation = 0, translation = 0;              ///< rad, m
  double rotation_sigma = 0, translation_sigma = 0;  ///< predicted by the covariances of both (RMS)
  bool has_prediction = false;                       ///< standard errors are known and finite
  double probability = 1;  ///< of a larger difference by these errors alone
  bool differs = false;    ///< probability below one in a hundred
};

/// Compares the poses of `camera` in the frame of `master`, wherever the rig's frame is, after the
/// motion T_b_a of both camera frames. The prediction is linear, with the correlations between
/// intrinsics and extrinsics of both files: a rotation of a camera and its principal point are hard
/// to separate, so that extrinsics alone are far less certain than the combination that is compared
/// here. The difference is tested by chi-square.
ExtrinsicsDifference CompareExtrinsics(const Counterparts& master,
                                       const Counterparts& camera,
                                       const Correlations& of_a,
                                       const Correlations& of_b);

/// Standard error of the projection that the covariance of a camera's parameters predicts, px: RMS
/// over the image and these distances, less the part that a motion of the camera frame compensates.
/// Infinite when a parameter is not determined. Throws `Error` when it images nothing.
double ImageSigma(const CalibratedCamera& camera, const std::vector<double>& distances);

}  // namespace plenocal
