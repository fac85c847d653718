// SPDX-License-Identifier: Apache-2.0
//
// Calibration problems with known truth.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/estimate/calibrate.h"
#include "calib/estimate/weak_unknowns.h"

namespace plenocal::testing {

inline std::vector<WeakUnknowns> WeakUnknownsOf(const Calibration& calibration) {
  return FindWeakUnknowns(calibration.bundle, calibration.uncertainty);
}

enum class TargetShape {
  kPlane,   ///< 10 x 7 points, 30 mm apart
  kCorner,  ///< three such planes at right angles
};

struct SyntheticOptions {
  TargetShape shape = TargetShape::kPlane;
  int cameras = 1;
  int frames = 15;
  double fov_deg = 60;          ///< horizontal
  double noise = 0;             ///< sigma of each coordinate, px
  double marker_tolerance = 0;  ///< sigma of the true markers about the nominal ones, m
  double visible = 1;           ///< probability that a camera sees the target in a frame
  double partial = 0;           ///< probability that a marker of a view is missing
  bool distorted = true;
  /// Sigmas of what each view's target pose has for itself: its centre (m) and turn (rad).
  double jitter_translation = 0, jitter_rotation = 0;
};

struct SyntheticProblem {
  CalibrationInput input;
  std::vector<std::vector<double>> params;   ///< per camera
  std::vector<RigidTransform> T_camera_rig;  ///< per camera
  std::map<int, Eigen::Vector3d> markers;    ///< the true ones
  std::map<std::string, RigidTransform> T_rig_target;
};

/// A random pinhole-radial3 rig before a target, all from `seed`.
SyntheticProblem MakeProblem(unsigned seed, const SyntheticOptions& options);

/// Gives a camera another model: no parameter is known or fixed.
void SetModel(const CameraModel& model, CameraInput* camera);

/// The same observations with noise of this sigma (px) added, which they state.
CalibrationInput WithNoise(CalibrationInput input, double sigma, unsigned seed);

/// The problem's truth as the state of an adjustment, with its noisy observations.
Bundle TrueBundle(const SyntheticProblem& problem);

/// Largest shift of the image, over all true observations, when the estimated camera takes the true
/// one's place, px; directions are the true camera's.
double LargestShift(const SyntheticProblem& problem, const Calibration& calibration, size_t camera);

/// The codes of findings, in their order.
std::vector<std::string> CodesOf(const std::vector<Finding>& findings);

}  // namespace plenocal::testing
