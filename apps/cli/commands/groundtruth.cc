// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "apps/groundtruth/image_tracks.h"
#include "apps/groundtruth/loop_truth_page.h"
#include "apps/groundtruth/recorded_tracks.h"
#include "calib/base/error.h"
#include "calib/base/number_text.h"
#include "calib/io/output_folder.h"
#include "engine/observe/left_out.h"
#include "engine/recording/layouts.h"
#include "engine/recording/recording.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

struct GroundtruthArguments {
  fs::path recording;
  fs::path calibration;              ///< empty: that of the recording
  std::vector<std::string> cameras;  ///< empty: those of the calibration that the recording has
  SegmentChoice segments;
  int points = 1000;  ///< followed at a time
  fs::path out;
};

CalibrationRecord ReadRigCalibration(const GroundtruthArguments& arguments,
                                     const RecordingFile& recording) {
  const fs::path& path =
      arguments.calibration.empty() ? recording.calibration : arguments.calibration;
  if (path.empty()) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: names no calibration; give --calibration calibration.yaml",
                            recording.path.string()));
  }
  return ReadWithCorrelations(path);
}

/// The chosen cameras, or those that recording and calibration have in common.
std::vector<std::string> ChooseCameras(const GroundtruthArguments& arguments,
                                       const RecordingFile& recording,
                                       const CalibrationRecord& calibration) {
  if (!arguments.cameras.empty()) return arguments.cameras;
  std::vector<std::string> names;
  for (const CalibratedCamera& camera : calibration.cameras) {
    const auto same = [&](const RecordedFiles& source) { return source.name == camera.name; };
    if (std::ranges::any_of(recording.cameras, same)) names.push_back(camera.name);
  }
  if (!names.empty()) return names;
  throw Error(ErrorKind::kInput,
              fmt::format("{}: has none of the cameras of {}; their names must be the same",
                          recording.path.string(),
                          calibration.path.string()));
}

/// The recording's own tracks, or those of its images.
LoopTracks CollectTracks(const GroundtruthArguments& arguments,
                         const RecordingFile& recording,
                         const CalibratedRig& rig,
                         int threads,
                         Console* console) {
  const auto has_tracks = [](const RecordedFiles& camera) { return !camera.tracks.empty(); };
  if (std::ranges::any_of(recording.cameras, has_tracks)) {
    LoopTracks loop;
    loop.tracks = ReadRecordedTracks(recording, rig.cameras);
    loop.segments = ChooseSegments(loop.tracks, arguments.segments);
    return loop;
  }
  ImageTrackOptions options;
  options.segments = arguments.segments;
  options.features.wanted = arguments.points;
  options.threads = threads;
  options.progress = [&](const std::string& stage, size_t done, size_t total) {
    return console->Progress(stage, done, total);
  };
  return TrackLoop(ReadRecording(arguments.recording), rig.cameras, options);
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

void RunGroundtruth(const GroundtruthArguments& arguments, const ConsoleOptions& shared) {
  Console console(shared);
  const RecordingFile recording = FindRecordingFile(arguments.recording);
  const CalibrationRecord calibration = ReadRigCalibration(arguments, recording);
  const CalibratedRig rig =
      MakeCalibratedRig(calibration, ChooseCameras(arguments, recording, calibration));
  OutputFolder output(arguments.out);
  const LoopTracks loop = CollectTracks(arguments, recording, rig, shared.threads, &console);
  for (const std::string& line : GroupedByReason(loop.left_out)) console.Message("  " + line);
  const SceneTracks& tracks = loop.tracks;
  const LoopTruthResult truth = EstimateLoopTruth(
      {.rig = &rig,
       .tracks = &tracks,
       .segments = loop.segments,
       .progress = [&](const std::string& stage) { return console.Progress(stage); }});
  for (const SegmentTruth* segment : {&truth.start, &truth.end}) {
    for (const size_t frame : segment->left_out) {
      console.Message(fmt::format("  left out {}: too few points agree", tracks.frames[frame]));
    }
  }
  const std::vector<std::string> findings = FindingsOf(truth, !loop.descriptors.empty());
  for (const std::string& finding : findings) console.Warning(finding);
  const LoopTruthContext context{.tracks = &tracks,
                                 .others = OtherCameras(calibration, rig),
                                 .descriptors = loop.descriptors,
                                 .findings = findings,
                                 .provenance = {{"recording", recording.path.string()},
                                                {"calibration", calibration.path.string()}}};
  for (const auto& [name, content] : LoopTruthFiles(truth, context)) output.Write(name, content);
  output.Write("report.html", LoopTruthPage(truth, context));
  output.Commit();
  console.Print(LoopTruthSummary(truth));
  console.Print(fmt::format("written to {}\n", arguments.out.string()));
}

constexpr const char* kGroundtruthHelp =
    "Ground truth of a loop: the poses of its start and end in one frame, from scene points.\n"
    "\n"
    "  plenocal groundtruth RECORDING --calibration calibration.yaml -o OUT\n"
    "  plenocal groundtruth RECORDING --cameras left,right --start 0:12 --end 301:320 -o OUT\n"
    "\n"
    "Writes segments_<camera>.txt, which `plenocal evaluate --truth` reads, their covariance and the "
    "points; docs/scene.md. Two of them, as from the stereo pair and from the plenoptic camera: "
    "plenocal compare A/groundtruth.yaml B/groundtruth.yaml.";

RunCommand DeclareGroundtruth(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<GroundtruthArguments>();
  app->add_option("recording", arguments->recording, "recording.yaml, or a folder")->required();
  app->add_option("--calibration",
                  arguments->calibration,
                  "calibration.yaml of the rig; else the one that the recording names");
  app->add_option("--cameras", arguments->cameras, "cameras to use; the first one's is the path")
      ->delimiter(',');
  app->add_option("--start", arguments->segments.start, "start segment A:B, seconds or frames");
  app->add_option("--end", arguments->segments.end, "end segment A:B, seconds or frames");
  app->add_option("--points", arguments->points, "scene points to follow at a time")
      ->check(CLI::Range(50, 100000))
      ->capture_default_str();
  app->add_option("-o,--out", arguments->out, "folder for the results")->required();
  AddQuiet(app, shared);
  AddThreads(app, shared);
  return [arguments, shared] { RunGroundtruth(*arguments, *shared); };
}

}  // namespace

Command GroundtruthCommand() { return {"groundtruth", kGroundtruthHelp, DeclareGroundtruth}; }

}  // namespace plenocal
