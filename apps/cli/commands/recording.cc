// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "apps/photometry/frame_exposures.h"
#include "calib/base/error.h"
#include "calib/base/number_text.h"
#include "calib/io/output_folder.h"
#include "engine/observe/session_observations.h"
#include "engine/recording/stores/message_log.h"
#include "engine/recording/summary.h"
#include "engine/recording/supplied_detections.h"
#include "models/registry.h"

namespace plenocal {
namespace {

struct RecordingArguments {
  std::filesystem::path path;
  bool json = false;
  bool markers = false;
  bool exposures = false;
  bool camera_info = false;
  std::filesystem::path out;  ///< folder for what is written
};

/// Writes the supplied markers of all cameras as detections.
void WriteMarkers(const Recording& recording, const std::filesystem::path& out, Console* console) {
  OutputContents files;
  for (size_t c = 0; c < recording.cameras.size(); ++c) {
    const RecordedCamera& camera = recording.cameras[c];
    if (!camera.markers) continue;
    const SuppliedDetections detections = ReadSuppliedDetections(recording, c);
    console->Message(fmt::format("{}: {}", camera.name, Counted(detections.points, "point")));
    if (detections.left_out > 0) {
      console->Warning(fmt::format("{}:{}: {} of images that the recording does not have",
                                   camera.markers->path.string(),
                                   detections.first_left_out,
                                   Counted(detections.left_out, "row")));
    }
    files.emplace_back(DetectionsName(camera.name), detections.csv);
  }
  if (files.empty()) {
    throw Error(
        ErrorKind::kInput,
        fmt::format("{}: has no supplied detections; name them in recording.yaml: "
                    "'markers: {{{}: {{file: markers.txt, columns: [frame, marker, x, y]}}}}'",
                    recording.path.string(),
                    recording.cameras[0].name));
  }
  for (const std::filesystem::path& written : WriteInto(out, files)) {
    console->Print(fmt::format("written to {}\n", written.string()));
  }
}

/// Compares the cameras' exposures and writes them as exposures.csv.
void WriteExposures(const Recording& recording,
                    const std::filesystem::path& out,
                    const ConsoleOptions& shared,
                    Console* console) {
  const FrameExposures exposures =
      CompareExposures(recording, shared.threads, [&](size_t done, size_t total) {
        if (Interrupted()) throw Stopped();
        console->Progress(fmt::format("exposures: frame {} of {}", done + 1, total));
      });
  for (const std::string& warning : exposures.warnings) console->Warning(warning);
  for (const LeftOut& item : exposures.left_out) {
    console->Message(fmt::format("  left out {}: {}", item.where, item.reason));
  }
  WriteInto(out, {{"exposures.csv", FrameExposuresCsv(recording, exposures)}});
  size_t different = 0;
  for (const RelativeExposure& image : exposures.images) {
    if (!image.differs) continue;
    ++different;
    console->Print(fmt::format("{} of {}: exposure {:+.1f} % +- {:.1f} % from {}, by {}\n",
                               image.frame,
                               image.camera,
                               100 * std::expm1(image.log_ratio),
                               100 * image.sigma,
                               std::isnan(image.recorded)
                                   ? "the usual ratio to the first camera's"
                                   : fmt::format("the recorded {:.4g} ms", image.recorded),
                               Counted(image.points, "point")));
  }
  console->Print(fmt::format("exposures differ in {} of {}\nwritten to {}\n",
                             different,
                             Counted(exposures.images.size(), "image"),
                             (out / "exposures.csv").string()));
}

/// Writes the intrinsics that a recording holds as camera files of ROS.
void WriteCameraInfo(const Recording& recording,
                     const std::filesystem::path& out,
                     Console* console) {
  OutputContents files;
  for (const ImageTopic& topic : recording.topics) {
    if (topic.camera_info.empty() || topic.camera.empty()) continue;
    const std::optional<CameraInfo> info = recording.log->ReadInfo(topic.camera_info);
    if (!info) continue;
    if (!(info->camera[0] > 0)) {
      console->Warning(fmt::format("{}: its focal length is {}: the driver had no calibration",
                                   topic.camera_info,
                                   info->camera[0]));
      continue;
    }
    files.emplace_back(fmt::format("camera_info_{}.yaml", topic.camera),
                       RosCameraYaml(*info, topic.camera));
  }
  if (files.empty()) {
    throw Error(
        ErrorKind::kInput,
        fmt::format("{}: has no camera_info with a calibration beside its images; 'plenocal "
                    "recording' lists its topics",
                    recording.path.string()));
  }
  for (const std::filesystem::path& written : WriteInto(out, files)) {
    console->Print(fmt::format("written to {}\n", written.string()));
  }
}

void RunRecording(const RecordingArguments& arguments, const ConsoleOptions& shared) {
  Console console(shared);
  const int writes = static_cast<int>(arguments.markers) + static_cast<int>(arguments.exposures) +
                     static_cast<int>(arguments.camera_info);
  if (writes > 1) {
    throw Error(ErrorKind::kInput, "--markers, --exposures and --camera-info: give one of them");
  }
  if ((writes == 1) == arguments.out.empty()) {
    throw Error(
        ErrorKind::kInput,
        "--markers, --exposures and --camera-info write into the folder of -o: give both or "
        "none");
  }
  console.Progress("read " + arguments.path.string());
  const Recording recording = ReadRecording(arguments.path);
  if (arguments.markers) {
    WriteMarkers(recording, arguments.out, &console);
    return;
  }
  if (arguments.exposures) {
    WriteExposures(recording, arguments.out, shared, &console);
    return;
  }
  if (arguments.camera_info) {
    WriteCameraInfo(recording, arguments.out, &console);
    return;
  }
  const RecordingSummary summary = Summarise(recording, CameraModels());
  fmt::print("{}",
             arguments.json ? SummaryJson(recording, summary)
                            : WithColours(SummaryText(recording, summary)));
}

constexpr const char* kRecordingHelp =
    "What a recording has: cameras, frames, times, exposures, and what commands lack.\n"
    "\n"
    "  plenocal recording DIR\n"
    "  plenocal recording drive.mcap\n"
    "  plenocal recording recording.yaml --markers -o OUT\n"
    "  plenocal recording recording.yaml --exposures -o OUT\n"
    "\n"
    "Reads recording.yaml, TUM monoVO, EuRoC, KITTI, folders, zip archives, MCAP files, bags of ROS 1 and ROS 2, videos; docs/recordings.md.";

RunCommand DeclareRecording(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<RecordingArguments>();
  app->add_option("recording",
                  arguments->path,
                  "folder, recording.yaml, zip archive, MCAP file, bag or video")
      ->required();
  app->add_flag("--json", arguments->json, "JSON on standard output");
  app->add_flag("--markers",
                arguments->markers,
                "write the supplied detections as OUT/detections_<camera>.csv");
  app->add_flag("--exposures",
                arguments->exposures,
                "compare the exposures of the cameras of each frame: OUT/exposures.csv");
  app->add_flag(
      "--camera-info",
      arguments->camera_info,
      "write the intrinsics of camera_info as OUT/camera_info_<camera>.yaml, which 'plenocal import --format ros' reads");
  app->add_option("-o,--out", arguments->out, "folder for the files");
  AddThreads(app, shared);
  AddQuiet(app, shared);
  return [arguments, shared] { RunRecording(*arguments, *shared); };
}

}  // namespace

Command RecordingCommand() { return {"recording", kRecordingHelp, DeclareRecording}; }

}  // namespace plenocal
