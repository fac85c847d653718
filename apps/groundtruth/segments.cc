// SPDX-License-Identifier: Apache-2.0
#include "apps/groundtruth/segments.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "apps/evaluate/trajectory_metrics.h"
#include "calib/base/format_error.h"
#include "calib/base/number_text.h"

namespace plenocal {
namespace {

constexpr double kStartSeconds = 15;
constexpr double kStartShare = 1.0 / 6;  // of frames without times

// An end of a segment: a frame's name, or seconds after the first frame.
std::optional<double> FindPosition(const SceneTracks& tracks, const std::string& text) {
  const auto named = std::ranges::find(tracks.frames, text);
  if (named != tracks.frames.end()) return static_cast<double>(named - tracks.frames.begin());
  const std::optional<double> seconds = ParseDouble(text);
  if (!seconds || !std::isfinite(*seconds) || tracks.times.empty()) return std::nullopt;
  const auto at = std::ranges::lower_bound(tracks.times, tracks.times.front() + *seconds - 1e-9);
  return static_cast<double>(at - tracks.times.begin());
}

std::vector<size_t> ReadSegment(const SceneTracks& tracks,
                                const std::string& text,
                                const char* option) {
  const size_t colon = text.find(':');
  const auto fail = [&](const std::string& reason) {
    throw InputError("{} {}: {}; write A:B, names of frames{}",
                     option,
                     text,
                     reason,
                     tracks.times.empty() ? "" : " or seconds");
  };
  if (colon == std::string::npos) fail("no ':'");
  const std::string first = text.substr(0, colon), last = text.substr(colon + 1);
  const std::optional<double> begin = first.empty() ? 0.0 : FindPosition(tracks, first);
  std::optional<double> end = static_cast<double>(tracks.frames.size());
  if (!last.empty()) {
    end = FindPosition(tracks, last);
    // A frame that is named belongs to the segment.
    if (end && std::ranges::find(tracks.frames, last) != tracks.frames.end()) *end += 1;
  }
  if (!begin || !end) fail(fmt::format("no frame '{}'", begin ? last : first));
  const std::vector<size_t> frames =
      FramesFrom(static_cast<size_t>(*begin), static_cast<size_t>(*end));
  if (frames.empty()) fail("no frames lie there");
  return frames;
}

std::vector<size_t> FirstFrames(const SceneTracks& tracks) {
  const size_t count = tracks.frames.size();
  if (tracks.times.empty()) {
    return FramesFrom(0, static_cast<size_t>(std::ceil(kStartShare * static_cast<double>(count))));
  }
  const auto end = std::ranges::upper_bound(tracks.times, tracks.times.front() + kStartSeconds);
  return FramesFrom(0, static_cast<size_t>(end - tracks.times.begin()));
}

// The frames before and after the largest gap in time, where one stands out.
std::optional<LoopSegments> SplitAtGap(const SceneTracks& tracks) {
  if (tracks.times.empty()) return std::nullopt;
  Trajectory times;
  times.times = tracks.times;
  times.positions.resize(times.times.size(), Eigen::Vector3d::Zero());
  times.orientations.resize(times.times.size(), Eigen::Quaterniond::Identity());
  const std::optional<LoopTruth> split = SplitAtLargestGap(times);
  if (!split) return std::nullopt;
  const size_t start = split->start.Size();
  return LoopSegments{FramesFrom(0, start), FramesFrom(start, tracks.frames.size())};
}

}  // namespace

std::vector<size_t> FramesFrom(size_t begin, size_t end) {
  std::vector<size_t> frames(end > begin ? end - begin : 0);
  std::iota(frames.begin(), frames.end(), begin);
  return frames;
}

LoopSegments ChooseSegments(
    const SceneTracks& tracks,
    const SegmentChoice& choice,
    const std::function<std::vector<size_t>(const std::vector<size_t>& start)>& find_end) {
  if (choice.start.empty() && choice.end.empty()) {
    if (const std::optional<LoopSegments> split = SplitAtGap(tracks)) return *split;
  }
  LoopSegments segments;
  segments.start =
      choice.start.empty() ? FirstFrames(tracks) : ReadSegment(tracks, choice.start, "--start");
  segments.end =
      choice.end.empty() ? find_end(segments.start) : ReadSegment(tracks, choice.end, "--end");
  if (segments.start.back() < segments.end.front()) return segments;
  const std::string message =
      fmt::format("the end segment begins at frame '{}', before the start segment ends at '{}'",
                  tracks.frames[segments.end.front()],
                  tracks.frames[segments.start.back()]);
  if (choice.start.empty() && choice.end.empty()) {
    throw JobError("{}; state them with --start and --end", message);
  }
  throw InputError("--start, --end: {}", message);
}

}  // namespace plenocal
