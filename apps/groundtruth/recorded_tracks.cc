// SPDX-License-Identifier: Apache-2.0
#include "apps/groundtruth/recorded_tracks.h"

#include <algorithm>
#include <map>
#include <set>

#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/files/detections.h"
#include "engine/recording/stores/image_index.h"

namespace plenocal {
namespace {

const RecordedFiles& FindTracks(const RecordingFile& recording, const std::string& name) {
  for (const RecordedFiles& camera : recording.cameras) {
    if (camera.name != name) continue;
    if (!camera.tracks.empty()) return camera;
    throw InputError(
        "{}: camera '{}' has no tracks, others have; give all of them tracks "
        "or images",
        recording.path.string(),
        name);
  }
  throw InputError("{}: has no camera '{}' of the calibration; choose by --cameras",
                   recording.path.string(),
                   name);
}

// Times of the frames by name.
void AddTimes(const RecordedFiles& camera, std::map<std::string, double>* times) {
  if (camera.times.empty()) return;
  for (const ImageTime& row : ReadImageTimes(camera.times, camera.exposure_unit).rows) {
    if (!row.id.empty()) times->emplace(row.id, row.time);
  }
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

std::vector<size_t> FramesThatSeeAgain(const SceneTracks& tracks, const std::set<int>& start) {
  size_t most = 0;
  for (size_t frame = tracks.frames.size() / 2; frame < tracks.frames.size(); ++frame) {
    size_t common = 0;
    for (const int point : PointsOf(tracks, {frame})) common += start.contains(point) ? 1 : 0;
    if (common >= kFewestCommon) return FramesFrom(frame, tracks.frames.size());
    most = std::max(most, common);
  }
  throw JobError(
      "start and end do not see the same scene: {} in common; give --start "
      "and --end",
      Counted(most, "point"));
}

}  // namespace

SceneTracks ReadRecordedTracks(const RecordingFile& recording,
                               const std::vector<BundleCamera>& cameras) {
  SceneTracks tracks;
  std::map<std::string, double> times;
  std::vector<std::string> names;
  for (const BundleCamera& camera : cameras) {
    const RecordedFiles& source = FindTracks(recording, camera.name);
    tracks.views.push_back(ReadDetections(source.tracks, *camera.model));
    AddTimes(source, &times);
    for (const View& view : tracks.views.back()) names.push_back(view.frame);
  }
  std::ranges::sort(names, NaturalLess);
  names.erase(std::unique(names.begin(), names.end()), names.end());
  if (!times.empty()) {
    for (const std::string& name : names) {
      if (times.contains(name)) continue;
      throw InputError("{}: no time for frame '{}' of the tracks", recording.path.string(), name);
    }
    std::ranges::stable_sort(names, {}, [&](const std::string& name) { return times.at(name); });
    for (const std::string& name : names) tracks.times.push_back(times.at(name));
  }
  tracks.frames = std::move(names);
  return tracks;
}

LoopSegments ChooseTrackedSegments(const SceneTracks& tracks, const SegmentChoice& choice) {
  return ChooseSegments(tracks, choice, [&](const std::vector<size_t>& start) {
    return FramesThatSeeAgain(tracks, PointsOf(tracks, start));
  });
}

}  // namespace plenocal
