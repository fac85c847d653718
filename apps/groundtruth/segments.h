// SPDX-License-Identifier: Apache-2.0
//
// The frames of a recording's start and end segment.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "engine/scene/scene_tracks.h"

namespace plenocal {

/// Where the segments begin and end: "A:B", in seconds of the recording's times or in names of
/// frames; either may be missing. Empty: not given.
struct SegmentChoice {
  std::string start, end;
};

/// Points that a frame must have in common with the start to belong to the end.
inline constexpr size_t kFewestCommon = 30;

/// Indices begin, ..., end - 1.
std::vector<size_t> FramesFrom(size_t begin, size_t end);

/// The frames before and after the largest gap in time, where one stands out.
std::optional<LoopSegments> SplitAtGap(const SceneTracks& tracks);

/// The frames that `choice` names; for an empty one the first 15 s, or of frames without times the
/// first sixth. Throws `Error` of kind kInput when it names none.
std::vector<size_t> StartFrames(const SceneTracks& tracks, const std::string& choice);

/// The frames that `choice` names, which is not empty. Throws likewise.
std::vector<size_t> EndFrames(const SceneTracks& tracks, const std::string& choice);

/// Throws `Error` of kind kInput when the end begins before the start ends.
void CheckOrder(const LoopSegments& segments);

}  // namespace plenocal
