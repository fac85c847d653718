// SPDX-License-Identifier: Apache-2.0
//
// The cameras that points in space are measured with, and what their calibration leaves uncertain.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// Calibrated cameras and the covariance C of theta (docs/space.md): their estimated parameters and
/// the charts of their extrinsics, the sizes of systematic displacements that all images of a
/// camera share, and the jitter of the images of one frame. The first camera's frame is the rig's.
struct SpaceRig {
  std::vector<BundleCamera> cameras;
  /// Parameters, charts, sizes of displacements; all of theta but the jitter.
  std::vector<CalibrationPrior::Unknown> unknowns;
  /// L with L L' = C; no column for a calibration without standard errors.
  Eigen::MatrixXd root;
  bool has_errors = false;  ///< the calibration states standard errors
  /// Numbers at the end of theta that each frame has anew, six of each camera: a translation and a
  /// rotation about `centre` (rig's frame) of what it sees. 0: a rigid, synchronous rig.
  Eigen::Index frame_columns = 0;
  Eigen::Vector3d centre{0, 0, 0};
  /// Derivative by theta of the rigid motion (translation, rotation vector; of the points, in the
  /// rig's frame) by which the calibration's own points follow an error of theta, 6 x theta; empty
  /// where the calibration has no residuals. Its points then hold the frame
  /// (`SpaceFrame::kHousing`).
  Eigen::MatrixXd follow;
  /// "left.f_x": numbers that the calibration leaves open, which are held at their values.
  std::vector<std::string> open;
  std::vector<CameraFit> fits;  ///< by camera
  /// Of the noise of one coordinate between two cameras, which all are ordinary then: points that
  /// were matched from image to image have common errors.
  double correlation = 0;

  /// Of the noise that cameras do not share over that of the calibration. What a bent board
  /// displaces alike in all cameras is noise of the calibration, not of a point.
  double noise_factor = 1;

  [[nodiscard]] Eigen::Index Size() const { return root.rows(); }
  /// Standard deviation of a coordinate without the part common to a marker, px: that of the
  /// calibration's typical observation, or of one with the detector's sigma `stated` (0: none);
  /// times `noise_factor`.
  [[nodiscard]] double NoiseOf(size_t camera, double stated) const;
};

/// The rig of the cameras of these names (empty: all), in this order. Standard errors that were
/// scaled for errors which the points of a frame share are scaled alike (`ScaleAlike`). Throws
/// `Error` of kind kInput for an unknown name.
/// `shared`: by camera, the number of `View::by_nuisance` of its images; sizes that the calibration
/// does not state are 0, with standard normal priors.
SpaceRig MakeSpaceRig(const CalibrationRecord& calibration,
                      const std::vector<std::string>& names,
                      const std::vector<size_t>& shared = {});

/// "left.f_x", "plenoptic.shared_1", "right.T_camera_rig.w_y": of `SpaceRig::unknowns`.
std::string NameOfUnknown(const SpaceRig& rig, size_t unknown);

/// Adds an error of theta (without the jitter) to the cameras.
void AddToTheta(const SpaceRig& rig,
                const Eigen::VectorXd& theta,
                std::vector<BundleCamera>* cameras);

}  // namespace plenocal
