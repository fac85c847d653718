// SPDX-License-Identifier: Apache-2.0
//
// Tracks that a recording supplies in place of images, and the segments that they show.
#pragma once

#include <vector>

#include "apps/groundtruth/segments.h"
#include "calib/adjust/bundle.h"
#include "engine/recording/recording_file.h"
#include "engine/scene/scene_tracks.h"

namespace plenocal {

/// The tracks that a recording supplies in place of images (`tracks` of recording.yaml), of these
/// cameras. Throws `Error` of kind kInput: a camera without tracks, frames without a time.
SceneTracks ReadRecordedTracks(const RecordingFile& recording,
                               const std::vector<BundleCamera>& cameras);

/// Frames of the segments by `ChooseSegments`: the end begins with the first frame after the middle
/// that shows `kFewestCommon` points of the start. Throws `Error` also of kind kJob when start and
/// end have too few points in common.
LoopSegments ChooseTrackedSegments(const SceneTracks& tracks, const SegmentChoice& choice);

}  // namespace plenocal
