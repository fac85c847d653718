// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "apps/cli/fleet/fleet_plan.h"
#include "apps/cli/options.h"
#include "calib/io/output_folder.h"

namespace plenocal {
namespace {

struct FleetArguments {
  std::filesystem::path plan, out;
  bool overview = false;
};

void RunFleet(const FleetArguments& arguments, Console* console) {
  const FleetPlan plan = ReadFleetPlan(arguments.plan);
  OutputFolder out(arguments.out);
  if (arguments.overview) {
    out.Write("overview.html", FleetPage(plan, arguments.out));
    out.Commit();
    console->PrintWritten((arguments.out / "overview.html"));
    return;
  }
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe");
  out.Write("Snakefile", Snakefile(plan, program));
  out.Commit();
  size_t runs = 0;
  for (const FleetRig& rig : plan.rigs) runs += rig.runs.size();
  console->Print(
      fmt::format("{} rigs, {} calibrations: written to {}; run it by\n"
                  "  cd {} && snakemake --cores all --keep-going --rerun-incomplete\n",
                  plan.rigs.size(),
                  runs,
                  (arguments.out / "Snakefile").string(),
                  arguments.out.string()));
}

constexpr const char* kFleetHelp =
    "Calibrations of many rigs at many dates as a Snakemake workflow, and an overview of them.\n\n"
    "  plenocal fleet plan.yaml -o RESULTS\n"
    "  cd RESULTS && snakemake --cores all --keep-going --rerun-incomplete\n\n"
    "The workflow shards detection, calibrates, compares each calibration with the one before and writes RESULTS/overview.html; docs/fleet.md.";

void DeclareFleet(CLI::App* app, FleetArguments* arguments, ConsoleOptions* shared) {
  app->add_option("plan", arguments->plan, "plan.yaml: rigs and their sessions")->required();
  app->add_option("-o,--out", arguments->out, "folder of the workflow and its results")->required();
  app->add_flag("--overview", arguments->overview, "only the page, of the results that are there");
  AddQuiet(app, shared);
}

}  // namespace

Command FleetCommand() { return MakeCommand("fleet", kFleetHelp, DeclareFleet, RunFleet); }

}  // namespace plenocal
