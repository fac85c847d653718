// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "apps/cli/options.h"
#include "apps/photometry/frame_exposures.h"
#include "calib/base/format_error.h"
#include "calib/io/output_folder.h"
#include "engine/recording/recording_summary.h"
#include "engine/recording/supplied_detections.h"
#include "models/formula/model.h"
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

void RunRecording(const RecordingArguments& arguments, Console* console) {
  const int writes = static_cast<int>(arguments.markers) + static_cast<int>(arguments.exposures) +
                     static_cast<int>(arguments.camera_info);
  if (writes > 1) {
    throw InputError("--markers, --exposures and --camera-info: give one of them");
  }
  if ((writes == 1) == arguments.out.empty()) {
    throw InputError(
        "--markers, --exposures and --camera-info write into the folder of -o: give both or "
        "none");
  }
  console->Progress("read " + arguments.path.string());
  const Recording recording = ReadRecording(arguments.path);
  const Run run = console->NewRun();
  if (arguments.exposures) {
    console->Print(MeasureExposures(recording, arguments.out, run) +
                   fmt::format("written to {}\n", (arguments.out / "exposures.csv").string()));
    return;
  }
  if (writes == 1) {
    const OutputContents files =
        arguments.markers ? SuppliedMarkers(recording, run) : CameraInfoFiles(recording, run);
    for (const std::filesystem::path& written : WriteInto(arguments.out, files)) {
      console->PrintWritten(written);
    }
    return;
  }
  if (!recording.calibration.empty()) AddFormulaModels(recording.calibration);
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

void DeclareRecording(CLI::App* app, RecordingArguments* arguments, ConsoleOptions* shared) {
  app->add_option("recording",
                  arguments->path,
                  "folder, recording.yaml, zip archive, MCAP file, bag or video")
      ->required();
  AddJson(app, &arguments->json);
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
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command RecordingCommand() {
  return MakeCommand("recording", kRecordingHelp, DeclareRecording, RunRecording);
}

}  // namespace plenocal
