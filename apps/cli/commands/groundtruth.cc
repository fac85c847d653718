// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "apps/groundtruth/loop_truth_files.h"
#include "apps/groundtruth/recorded_loop.h"

namespace plenocal {
namespace {

void RunGroundtruth(const GroundtruthRequest& arguments, const ConsoleOptions& shared) {
  Console console(shared);
  console.Print(LoopTruthSummary(EstimateRecordedLoop(arguments, console.NewRun())));
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
  const auto arguments = std::make_shared<GroundtruthRequest>();
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
  AddThreadsAndQuiet(app, shared);
  return [arguments, shared] { RunGroundtruth(*arguments, *shared); };
}

}  // namespace

Command GroundtruthCommand() { return {"groundtruth", kGroundtruthHelp, DeclareGroundtruth}; }

}  // namespace plenocal
