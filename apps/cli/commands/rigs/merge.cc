// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "apps/cli/options.h"
#include "engine/rigs/merge_calibrations.h"

namespace plenocal {
namespace {

void RunMerge(const MergeRequest& arguments, Console* console) {
  const MergedFiles result = MergeFiles(arguments, console->NewRun());
  console->Print(fmt::format("{}\nwritten to {}\n", MergeText(result), arguments.out.string()));
}

constexpr const char* kMergeHelp =
    "Several calibrations of one rig as one: of several days, or of subsets of its cameras.\n"
    "\n"
    "  plenocal merge MONDAY FRIDAY -o OUT\n"
    "\n"
    "writes OUT/calibration.yaml with one covariance (correlations.csv), and merge.csv: how far each calibration is from all together. What differs by more than the standard errors explain is named. Cameras that moved on the rig in between get a place in each calibration by --moved; the result has the last one.";

void DeclareMerge(CLI::App* app, MergeRequest* arguments, ConsoleOptions* shared) {
  app->add_option("calibrations",
                  arguments->calibrations,
                  "folders that 'plenocal calibrate' wrote, or their calibration.yaml")
      ->required()
      ->expected(2, -1);
  app->add_option("--moved",
                  arguments->moved,
                  "cameras that moved on the rig between the calibrations, separated by commas")
      ->delimiter(',');
  AddOut(app, &arguments->out);
  AddQuiet(app, shared);
}

}  // namespace

Command MergeCommand() { return MakeCommand("merge", kMergeHelp, DeclareMerge, RunMerge); }

}  // namespace plenocal
