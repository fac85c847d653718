// SPDX-License-Identifier: Apache-2.0

#include "apps/cli/options.h"
#include "apps/groundtruth/loop_truth_files.h"
#include "apps/groundtruth/recorded_loop.h"

namespace plenocal {
namespace {

void RunGroundtruth(const GroundtruthRequest& arguments, Console* console) {
  console->Print(LoopTruthSummary(EstimateRecordedLoop(arguments, console->NewRun())));
  console->PrintWritten(arguments.out);
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

void DeclareGroundtruth(CLI::App* app, GroundtruthRequest* arguments, ConsoleOptions* shared) {
  AddRecording(app, &arguments->recording);
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
  AddOut(app, &arguments->out);
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command GroundtruthCommand() {
  return MakeCommand("groundtruth", kGroundtruthHelp, DeclareGroundtruth, RunGroundtruth);
}

}  // namespace plenocal
