// SPDX-License-Identifier: Apache-2.0
//
// Table of the causes of bad calibrations (docs/diagnosis.md). Each cause is one file of
// assess/causes/target or assess/causes/recording: focus_changed.cc defines `Cause
// FocusChangedCause()`. CMake finds the files and generates the table `Causes()`, so a new cause is
// a new file and edits no other.
#pragma once

#include <map>
#include <span>
#include <string>
#include <vector>

#include "assess/causes/view_rows.h"
#include "assess/finding_role.h"
#include "calib/camera/image_traits.h"
#include "calib/camera/target_hypothesis.h"
#include "calib/estimate/calibrate.h"
#include "calib/files/finding.h"

namespace plenocal {

/// What a cause is tested on, in the order in which `FindTargetCauses` and `Diagnose` proceed.
enum class CauseStage {
  kLayout,     ///< the points of all cameras, without a calibration
  kTarget,     ///< the calibration and the target's file, where no cause in the layout was found
  kRig,        ///< poses of the cameras of a rig
  kImageFile,  ///< properties of a camera's image files, before any calibration
  kImages,     ///< the images of a camera, whatever the target
  kPoints,     ///< residuals of a camera's points, where no cause in the target was found
  kMotion,     ///< likewise: residuals of a camera's frames
  kNoise,      ///< likewise: noise of a camera's images
};

/// Data for the tests of causes. The members that a stage has are set, the others are empty.
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
  /// Of kMotion; empty for exact (simulated) points, which have no noise to compare with.
  std::vector<ViewRows> views = {};
};

/// One cause, or several that are separated by one test.
struct Cause {
  CauseStage stage = CauseStage::kPoints;
  /// Findings with code, grade and text; none where the cause is not in the data.
  /// `FindCauses` adds the camera where the stage has one. Tests have a false-alarm rate of 1e-3 a
  /// camera or less.
  std::vector<Finding> (*find)(const CauseEvidence& evidence) = nullptr;
  std::vector<FindingCode> codes = {};  ///< of all its findings, with their roles
};

/// All causes, in alphabetical order of their files, which is that of findings of one stage.
std::span<const Cause> Causes();

/// Findings of all causes of a stage.
std::vector<Finding> FindCauses(CauseStage stage, const CauseEvidence& evidence);

/// The codes of all causes.
std::span<const FindingCode> CauseCodes();

}  // namespace plenocal
