// SPDX-License-Identifier: Apache-2.0
//
// Table of the causes of bad calibrations (docs/diagnosis.md). Each cause is one file of
// assess/causes/target or assess/causes/recording: focus_changed.cc defines `Cause
// FocusChangedCause()`. CMake finds the files and generates the table `Causes()`, so that a new
// cause needs a new file only.
#pragma once

#include <map>
#include <span>
#include <string>
#include <vector>

#include "assess/causes/view_rows.h"
#include "calib/camera/target_hypothesis.h"
#include "calib/estimate/calibrate.h"
#include "calib/files/finding.h"
#include "calib/traits/image_traits.h"

namespace plenocal {

/// Data on which a cause is tested. `FindTargetCauses` and `Diagnose` run the stages in this order.
enum class CauseStage {
  kLayout,     ///< the points of all cameras, without a calibration
  kTarget,     ///< the calibration and the target's file, if kLayout has found no cause
  kRig,        ///< poses of the cameras of a rig
  kImageFile,  ///< properties of a camera's image files, before any calibration
  kImages,     ///< the images of a camera, also if the target has a cause
  kPoints,     ///< residuals of a camera's points, if the target has no cause
  kMotion,     ///< residuals of a camera's frames, likewise
  kNoise,      ///< noise of a camera's images, likewise
};

/// Data for the tests of causes. Only the members of the present stage are set.
struct CauseEvidence {
  /// Of kLayout and kTarget: cameras with their points, marker positions of the target's file, m,
  /// and what may be wrong in that file.
  const std::vector<CameraInput>* inputs = nullptr;
  const std::map<int, Eigen::Vector3d>* markers = nullptr;
  const TargetDoubts* doubts = nullptr;
  /// Of all stages but kLayout and kImageFile.
  const Calibration* calibration = nullptr;
  /// Of the stages of one camera (from kImageFile on): index, name, properties of its images.
  size_t camera = 0;
  std::string name = {};
  const CameraTraits* traits = nullptr;
  /// Of kMotion; empty for exact (simulated) points, whose residuals are rounding errors.
  std::vector<ViewRows> views = {};
};

/// One cause, or several that one test tells apart.
struct Cause {
  CauseStage stage = CauseStage::kPoints;
  /// Tests for the cause: findings with code, role, grade and text, none if the data do not show
  /// it. `FindCauses` adds the camera in stages of one camera. False-alarm rates are at most 1e-3
  /// per camera.
  std::vector<Finding> (*find)(const CauseEvidence& evidence) = nullptr;
};

/// All causes in alphabetical order of their files. Findings of one stage have the same order.
std::span<const Cause> Causes();

/// Findings of all causes of a stage.
std::vector<Finding> FindCauses(CauseStage stage, const CauseEvidence& evidence);

}  // namespace plenocal
