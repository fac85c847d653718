// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>
#include <utility>
#include <vector>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "apps/cli/session_observations.h"
#include "apps/recording/summary.h"
#include "apps/recording/supplied_detections.h"
#include "calib/base/error.h"
#include "calib/base/number_text.h"
#include "calib/base/output_folder.h"
#include "models/registry.h"

namespace plenocal {
namespace {

struct RecordingArguments {
  std::filesystem::path path;
  bool json = false;
  bool markers = false;
  std::filesystem::path out;  ///< folder for the detections
};

/// Writes the supplied markers of all cameras as detections.
void WriteMarkers(const Recording& recording, const std::filesystem::path& out, Console* console) {
  std::vector<std::pair<std::string, std::string>> files;
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
  OutputFolder output(out);
  for (const auto& [name, content] : files) output.Write(name, content);
  output.Commit();
  for (const auto& [name, content] : files) {
    console->Print(fmt::format("written to {}\n", (out / name).string()));
  }
}

void RunRecording(const RecordingArguments& arguments, const ConsoleOptions& shared) {
  Console console(shared);
  if (arguments.markers == arguments.out.empty()) {
    throw Error(ErrorKind::kInput,
                "--markers writes supplied detections into the folder of -o: give both or none");
  }
  console.Progress("read " + arguments.path.string());
  const Recording recording = ReadRecording(arguments.path);
  if (arguments.markers) {
    WriteMarkers(recording, arguments.out, &console);
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
    "  plenocal recording recording.yaml --markers -o OUT\n"
    "\n"
    "Layouts: recording.yaml, TUM monoVO, EuRoC, KITTI, folders, zip archives; docs/recordings.md.";

RunCommand DeclareRecording(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<RecordingArguments>();
  app->add_option("recording", arguments->path, "folder, recording.yaml or zip archive")
      ->required();
  app->add_flag("--json", arguments->json, "JSON on standard output");
  app->add_flag("--markers",
                arguments->markers,
                "write the supplied detections as OUT/detections_<camera>.csv");
  app->add_option("-o,--out", arguments->out, "folder for the detections");
  AddQuiet(app, shared);
  return [arguments, shared] { RunRecording(*arguments, *shared); };
}

}  // namespace

Command RecordingCommand() { return {"recording", kRecordingHelp, DeclareRecording}; }

}  // namespace plenocal
