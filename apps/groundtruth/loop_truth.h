// SPDX-License-Identifier: Apache-2.0
//
// Ground truth of a loop: the poses of its start and its end in one frame, from one adjustment
// over the scene points of both. Source of the idea: N. Zeller, F. Quint, U. Stilla, "A
// Synchronized Stereo and Plenoptic Visual Odometry Dataset", arXiv:1807.09372, "Ground Truth and
// Evaluation Metric".
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "calib/prior/calibrated_rig.h"
#include "calib/scene/segment_covariance.h"
#include "engine/scene/alternative_pose.h"
#include "engine/scene/scene_tracks.h"

namespace plenocal {

struct LoopTruthInput {
  const CalibratedRig* rig = nullptr;
  const SceneTracks* tracks = nullptr;
  LoopSegments segments;
  /// Called with the present stage; false stops (`Stopped` is thrown).
  std::function<bool(const std::string& stage)> progress;
};

/// A segment after the adjustment.
struct SegmentTruth {
  std::vector<size_t> frames;    ///< those with a pose
  std::vector<size_t> left_out;  ///< those without
};

struct LoopTruthResult {
  Bundle bundle;  ///< at the optimum; `T_rig_target` is T_rig_world, the first frame's is identity
  SegmentTruth start, end;
  LoopCovariance covariance;
  size_t points = 0;                     ///< landmarks with used observations
  size_t common = 0;                     ///< of them, those that both segments show
  size_t observations = 0;               ///< used
  std::vector<double> rms;               ///< per camera, of the residual's length, px
  std::optional<AlternativePose> rival;  ///< of the end segment; not ambiguous
  bool converged = false;
  int iterations = 0;
  /// Change of the calibration against its prior: squared length in its own sigmas, the number of
  /// its unknowns, and the unknown that moved most, in sigmas.
  double prior_change = 0;
  int prior_unknowns = 0;
  std::string most_changed;
  double most_changed_sigmas = 0;
};

/// Throws `Error` of kind kJob: too few points, a segment that no pose can be found for, no common
/// points of start and end, an end that fits the start in two ways.
LoopTruthResult EstimateLoopTruth(const LoopTruthInput& input);

}  // namespace plenocal
