// SPDX-License-Identifier: Apache-2.0
#include "apps/groundtruth/segments.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "apps/evaluate/trajectory_metrics.h"
#include "calib/base/format_error.h"
#include "calib/base/number_text.h"

namespace plenocal {
namespace {

constexpr double kStartSeconds = 15;
constexpr double kStartShare = 1.0 / 6;  // of frames without times

// An end of a segment: a frame's name, or seconds after the first frame.
std::optional<double> PlaceOf(const SceneTracks& tracks, const std::string& text) {
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
  const std::optional<double> begin = first.empty() ? 0.0 : PlaceOf(tracks, first);
  std::optional<double> end = static_cast<double>(tracks.frames.size());
  if (!last.empty()) {
    end = PlaceOf(tracks, last);
    // A frame that is named belongs to the segment.
    if (end && std::ranges::find(tracks.frames, last) != tracks.frames.end()) *end += 1;
  }
  if (!begin || !end) fail(fmt::format("no frame '{}'", begin ? last : first));
  std::vector<size_t> frames;
  for (auto i = static_cast<size_t>(*begin); i < static_cast<size_t>(*end); ++i) {
    frames.push_back(i);
  }
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

}  // namespace

std::vector<size_t> FramesFrom(size_t begin, size_t end) {
  std::vector<size_t> frames;
  for (size_t i = begin; i < end; ++i) frames.push_back(i);
  return frames;
}

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

std::vector<size_t> StartFrames(const SceneTracks& tracks, const std::string& choice) {
  return choice.empty() ? FirstFrames(tracks) : ReadSegment(tracks, choice, "--start");
}

std::vector<size_t> EndFrames(const SceneTracks& tracks, const std::string& choice) {
  return ReadSegment(tracks, choice, "--end");
}

void CheckOrder(const LoopSegments& segments) {
  if (segments.start.back() < segments.end.front()) return;
  throw InputError("the end segment begins before the start segment ends");
}

}  // namespace plenocal
