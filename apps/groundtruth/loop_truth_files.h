// SPDX-License-Identifier: Apache-2.0
//
// The result files of `groundtruth` (docs/formats.md).
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

#include "apps/groundtruth/loop_truth.h"
#include "calib/camera/rigid_transform.h"

namespace plenocal {

/// A camera whose path follows from the rig's.
struct MountedCamera {
  std::string name;
  RigidTransform T_camera_rig;
};

/// Data of the files besides the result.
struct LoopTruthContext {
  const SceneTracks* tracks = nullptr;
  /// Cameras of the calibration whose images were not used; they get paths too, so that their
  /// trajectories can be evaluated and truths of different cameras compared.
  std::vector<MountedCamera> others = {};
  cv::Mat descriptors = {};           ///< row i is of track i; empty: not known
  std::vector<std::string> findings;  ///< warnings, in sentences
  std::vector<std::pair<std::string, std::string>> provenance;
};

/// Weaknesses and errors that the result shows, in sentences with what to do. `from_images`: the
/// tracks are patches followed through images.
std::vector<std::string> FindingsOf(const LoopTruthResult& truth, bool from_images);

/// Floor of the alignment error of loops of some lengths (circles): (m, m).
std::vector<std::pair<double, double>> AlignmentFloors(const LoopTruthResult& truth);

/// Names and contents of all result files but the report.
std::vector<std::pair<std::string, std::string>> LoopTruthFiles(const LoopTruthResult& truth,
                                                                const LoopTruthContext& context);

/// For the terminal: scale, alignment, points, in lines.
std::string LoopTruthSummary(const LoopTruthResult& truth);

}  // namespace plenocal
