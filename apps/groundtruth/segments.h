// SPDX-License-Identifier: Apache-2.0
//
// The frames of a recording's start and end segment.
#pragma once

#include <functional>
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

/// Frames of the segments. Not given: the recording's largest gap splits it; where none stands out,
/// the start is its first 15 s (of frames without times: the first sixth), and `find_end` gives the
/// frames that see the start again. Throws `Error` of kind kInput for a choice that names no frames
/// or an end that begins before the start ends.
LoopSegments ChooseSegments(
    const SceneTracks& tracks,
    const SegmentChoice& choice,
    const std::function<std::vector<size_t>(const std::vector<size_t>& start)>& find_end);

}  // namespace plenocal
