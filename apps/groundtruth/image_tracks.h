// SPDX-License-Identifier: Apache-2.0
//
// Tracks of scene points in the start and end of a recording, from its images.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "apps/groundtruth/recorded_tracks.h"
#include "engine/recording/recording.h"
#include "engine/scene/track/feature_tracker.h"

namespace plenocal {

/// Tracks of both segments, with the pairs of tracks that show the same point by their descriptors.
struct LoopTracks {
  SceneTracks tracks;
  LoopSegments segments;
  cv::Mat descriptors;  ///< row i is of track i; empty where the recording supplies the tracks
  std::vector<LeftOut> left_out = {};  ///< images that cannot be used
};

struct ImageTrackOptions {
  SegmentChoice segments;
  FeatureOptions features;
  int threads = 0;  ///< 0: all cores
  /// Called with the present stage and how much of it is done; false stops (`Stopped` is thrown).
  std::function<bool(const std::string& stage, size_t done, size_t total)> progress;
};

/// The cameras are in `recording`, plenoptic ones with white images. Segments that are not given
/// are chosen as `ChooseSegments` does, the end by features that the first camera shows in both.
/// Throws `Error`: of kind kInput for a camera that the recording does not have or another image
/// size than the calibration's, of kind kJob when the recording's end does not show the start's
/// scene.
LoopTracks TrackLoop(const Recording& recording,
                     const std::vector<BundleCamera>& cameras,
                     const ImageTrackOptions& options);

}  // namespace plenocal
