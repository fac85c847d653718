// SPDX-License-Identifier: Apache-2.0
#include "apps/scene/recorded_tracks.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>

#include "apps/evaluate/trajectory_metrics.h"
#include "apps/recording/image_files.h"
#include "calib/base/error.h"
#include "calib/base/number_text.h"
#include "calib/files/detections.h"

namespace plenocal {
namespace {

constexpr double kStartSeconds = 15;
constexpr double kStartShare = 1.0 / 6;  // of frames without times

const RecordedFiles& SourceOf(const RecordingFile& recording, const std::string& name) {
  for (const RecordedFiles& camera : recording.cameras) {
    if (camera.name != name) continue;
    if (!camera.tracks.empty()) return camera;
    throw Error(ErrorKind::kInput,
                fmt::format("{}: camera '{}' has no tracks, others have; give all of them tracks "
                            "or images",
                            recording.path.string(),
                            name));
  }
  throw Error(ErrorKind::kInput,
              fmt::format("{}: has no camera '{}' of the calibration; choose by --cameras",
                          recording.path.string(),
                          name));
}

// Times of the frames by name.
void AddTimes(const RecordedFiles& camera, std::map<std::string, double>* times) {
  if (camera.times.empty()) return;
  for (const ImageTime& row : ReadImageTimes(camera.times, camera.exposure_unit).rows) {
    if (!row.id.empty()) times->emplace(row.id, row.time);
  }
}

// An end of a segment: a frame's name, or seconds after the first frame.
std::optional<double> PlaceOf(const SceneTracks& tracks, const std::string& text) {
  const auto named = std::ranges::find(tracks.frames, text);
  if (named != tracks.frames.end()) return static_cast<double>(named - tracks.frames.begin());
  const std::optional<double> seconds = ParseDouble(text);
  if (!seconds || tracks.times.empty()) return std::nullopt;
  const auto at =
      std::ranges::lower_bound(tracks.times, tracks.times.front() + *seconds - 1e-9);
  return static_cast<double>(at - tracks.times.begin());
}

std::vector<size_t> ReadSegment(const SceneTracks& tracks,
                                const std::string& text,
                                const char* option) {
  const size_t colon = text.find(':');
  const auto fail = [&](const std::string& reason) {
    throw Error(ErrorKind::kInput,
                fmt::format("{} {}: {}; write A:B, names of frames{}",
                            option,
                            text,
                            reason,
                            tracks.times.empty() ? "" : " or seconds"));
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

std::set<int> PointsOf(const SceneTracks& tracks, const std::vector<size_t>& frames) {
  std::set<std::string> names;
  for (const size_t frame : frames) names.insert(tracks.frames[frame]);
  std::set<int> points;
  for (const std::vector<View>& views : tracks.views) {
    for (const View& view : views) {
      if (!names.contains(view.frame)) continue;
      for (const Observation& seen : view.observations) points.insert(seen.marker);
    }
  }
  return points;
}

std::vector<size_t> FramesFrom(size_t begin, size_t end) {
  std::vector<size_t> frames;
  for (size_t i = begin; i < end; ++i) frames.push_back(i);
  return frames;
}

// The frames before and after the largest gap in time, where one stands out.
std::optional<LoopSegments> SplitAtGap(const SceneTracks& tracks) {
  Trajectory times;
  times.times = tracks.times;
  times.positions.resize(times.times.size(), Eigen::Vector3d::Zero());
  times.orientations.resize(times.times.size(), Eigen::Quaterniond::Identity());
  const std::optional<LoopTruth> split = SplitAtLargestGap(times);
  if (!split) return std::nullopt;
  const size_t start = split->start.Size();
  return LoopSegments{FramesFrom(0, start), FramesFrom(start, tracks.frames.size())};
}

std::vector<size_t> FirstFrames(const SceneTracks& tracks) {
  const size_t count = tracks.frames.size();
  if (tracks.times.empty()) {
    return FramesFrom(0, static_cast<size_t>(std::ceil(kStartShare * static_cast<double>(count))));
  }
  const auto end = std::ranges::upper_bound(tracks.times, tracks.times.front() + kStartSeconds);
  return FramesFrom(0, static_cast<size_t>(end - tracks.times.begin()));
}

std::vector<size_t> FramesThatSeeAgain(const SceneTracks& tracks, const std::set<int>& start) {
  size_t most = 0;
  for (size_t frame = tracks.frames.size() / 2; frame < tracks.frames.size(); ++frame) {
    size_t common = 0;
    for (const int point : PointsOf(tracks, {frame})) common += start.contains(point) ? 1 : 0;
    if (common >= kFewestCommon) return FramesFrom(frame, tracks.frames.size());
    most = std::max(most, common);
  }
  throw Error(ErrorKind::kJob,
              fmt::format("start and end do not see the same scene: {} in common; give --start "
                          "and --end",
                          Counted(most, "point")));
}

}  // namespace

SceneTracks ReadRecordedTracks(const RecordingFile& recording,
                               const std::vector<BundleCamera>& cameras) {
  SceneTracks tracks;
  std::map<std::string, double> times;
  std::vector<std::string> names;
  for (const BundleCamera& camera : cameras) {
    const RecordedFiles& source = SourceOf(recording, camera.name);
    tracks.views.push_back(ReadDetections(source.tracks, *camera.model));
    AddTimes(source, &times);
    for (const View& view : tracks.views.back()) names.push_back(view.frame);
  }
  std::ranges::sort(names, NaturalLess);
  names.erase(std::unique(names.begin(), names.end()), names.end());
  if (!times.empty()) {
    for (const std::string& name : names) {
      if (times.contains(name)) continue;
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: no time for frame '{}' of the tracks",
                              recording.path.string(),
                              name));
    }
    std::ranges::stable_sort(names, {}, [&](const std::string& name) { return times.at(name); });
    for (const std::string& name : names) tracks.times.push_back(times.at(name));
  }
  tracks.frames = std::move(names);
  return tracks;
}

LoopSegments ChooseSegments(const SceneTracks& tracks, const SegmentChoice& choice) {
  LoopSegments segments;
  if (choice.start.empty() && choice.end.empty() && !tracks.times.empty()) {
    if (const std::optional<LoopSegments> split = SplitAtGap(tracks)) return *split;
  }
  segments.start = choice.start.empty() ? FirstFrames(tracks)
                                        : ReadSegment(tracks, choice.start, "--start");
  segments.end = choice.end.empty()
                     ? FramesThatSeeAgain(tracks, PointsOf(tracks, segments.start))
                     : ReadSegment(tracks, choice.end, "--end");
  if (segments.start.back() < segments.end.front()) return segments;
  throw Error(ErrorKind::kInput, "the end segment begins before the start segment ends");
}

}  // namespace plenocal
