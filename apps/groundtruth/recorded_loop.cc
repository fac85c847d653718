// SPDX-License-Identifier: Apache-2.0
#include "apps/groundtruth/recorded_loop.h"

#include <fmt/format.h>

#include <algorithm>

#include "apps/groundtruth/image_tracks.h"
#include "apps/groundtruth/loop_truth_files.h"
#include "apps/groundtruth/loop_truth_page.h"
#include "apps/groundtruth/recorded_tracks.h"
#include "calib/base/format_error.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "engine/observe/left_out.h"
#include "engine/recording/layouts.h"
#include "engine/recording/recording.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {
namespace {

/// The chosen cameras, or those that recording and calibration have in common.
std::vector<std::string> ChooseCameras(const GroundtruthRequest& request,
                                       const RecordingFile& recording,
                                       const CalibrationRecord& calibration) {
  if (!request.cameras.empty()) return request.cameras;
  std::vector<std::string> names;
  for (const CalibratedCamera& camera : calibration.cameras) {
    const auto same = [&](const RecordedFiles& source) { return source.name == camera.name; };
    if (std::ranges::any_of(recording.cameras, same)) names.push_back(camera.name);
  }
  if (!names.empty()) return names;
  throw InputError("{}: has none of the cameras of {}; their names must be the same",
                   recording.path.string(),
                   calibration.path.string());
}

/// The recording's own tracks, or those of its images.
LoopTracks CollectTracks(const GroundtruthRequest& request,
                         const RecordingFile& recording,
                         const CalibratedRig& rig,
                         const Run& run) {
  const auto has_tracks = [](const RecordedFiles& camera) { return !camera.tracks.empty(); };
  if (std::ranges::any_of(recording.cameras, has_tracks)) {
    LoopTracks loop;
    loop.tracks = ReadRecordedTracks(recording, rig.cameras);
    loop.segments = ChooseTrackedSegments(loop.tracks, request.segments);
    return loop;
  }
  ImageTrackOptions options;
  options.segments = request.segments;
  options.features.wanted = request.points;
  options.threads = run.threads;
  options.progress = [&](const std::string& stage, size_t done, size_t total) {
    return run.Progress(stage, done, total);
  };
  return TrackLoop(ReadRecording(request.recording), rig.cameras, options);
}

/// The cameras of the calibration beside those of `rig`.
std::vector<MountedCamera> OtherCameras(const CalibrationRecord& calibration,
                                        const CalibratedRig& rig) {
  const RigidTransform T_calibrated_rig =
      FindCamera(calibration, rig.cameras[0].name).T_camera_rig.Inverse();
  std::vector<MountedCamera> others;
  for (const CalibratedCamera& camera : calibration.cameras) {
    const auto used = [&](const BundleCamera& each) { return each.name == camera.name; };
    if (std::ranges::any_of(rig.cameras, used)) continue;
    others.push_back({camera.name, camera.T_camera_rig * T_calibrated_rig});
  }
  return others;
}

}  // namespace

LoopTruthResult EstimateRecordedLoop(const GroundtruthRequest& request, const Run& run) {
  const RunScope inputs;
  const RecordingFile recording = FindRecordingFile(request.recording);
  const CalibrationRecord calibration = OpenWithCorrelations(
      CalibrationOf(recording.path, recording.calibration, request.calibration));
  const CalibratedRig rig =
      MakeCalibratedRig(calibration, ChooseCameras(request, recording, calibration));
  const auto out = OpenOutput(request.out);
  const LoopTracks loop = CollectTracks(request, recording, rig, run);
  for (const std::string& line : GroupedByReason(loop.left_out)) run.Message("  " + line);
  const SceneTracks& tracks = loop.tracks;
  LoopTruthResult truth = EstimateLoopTruth(
      {.rig = &rig,
       .tracks = &tracks,
       .segments = loop.segments,
       .progress = [&](const std::string& stage) { return run.Progress(stage); }});
  for (const SegmentTruth* segment : {&truth.start, &truth.end}) {
    for (const size_t frame : segment->left_out) {
      run.Message(fmt::format("  left out {}: too few points agree", tracks.frames[frame]));
    }
  }
  const std::vector<std::string> findings = FindingsOf(truth, !loop.descriptors.empty());
  for (const std::string& finding : findings) run.Warning(finding);
  const LoopTruthContext context{.tracks = &tracks,
                                 .others = OtherCameras(calibration, rig),
                                 .descriptors = loop.descriptors,
                                 .findings = findings,
                                 .provenance = {{"recording", recording.path.string()},
                                                {"calibration", calibration.path.string()}}};
  if (!out) return truth;
  for (const auto& [name, content] : LoopTruthFiles(truth, context)) out->Write(name, content);
  out->Write("report.html", LoopTruthPage(truth, context));
  out->Commit();
  return truth;
}

}  // namespace plenocal
