// SPDX-License-Identifier: Apache-2.0
//
// Tracks of scene points, and the bundle that they make.
#pragma once

#include <span>
#include <string>
#include <utility>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/camera/observation.h"

namespace plenocal {

/// Scene points followed through the images of a rig: one number a point over all cameras.
struct SceneTracks {
  std::vector<std::string> frames;       ///< names, in the order of the recording
  std::vector<double> times;             ///< per frame, s; empty: not known
  std::vector<std::vector<View>> views;  ///< per camera; their frames are in `frames`
  /// Numbers of the end's points with those of the start's that look the same; some are wrong.
  std::vector<std::pair<int, int>> matches = {};
};

/// Frames of the two segments: indices into `SceneTracks::frames`, ascending.
struct LoopSegments {
  std::vector<size_t> start, end;
};

/// A bundle of the points that at least two views show, of unknown poses and positions, and the
/// cameras given.
Bundle MakeSceneBundle(const SceneTracks& tracks, const std::vector<BundleCamera>& cameras);

/// Brings the observations into the bundle's order.
void SortObservations(Bundle* bundle);

/// Median of `BundleObservation::assumed_sigma` per camera, px.
std::vector<double> TypicalSigmas(const Bundle& bundle);

}  // namespace plenocal
