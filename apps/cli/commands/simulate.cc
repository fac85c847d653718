// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/simulate.h"

#include <fmt/format.h>

#include "apps/cli/console.h"
#include "apps/cli/options.h"
#include "models/registry.h"

namespace plenocal {
namespace {

void RunSimulate(const SimulateRequest& request, Console* console) {
  const std::string summary =
      Simulate(request,
               {.models = CameraModels(),
                .program = console->Options().program,
                .threads = console->Options().threads,
                .progress = [&](const std::string& stage, size_t done, size_t total) {
                  return console->Progress(stage, done, total);
                }});
  console->Print(fmt::format("{}written to {}\n", summary, request.out.string()));
}

constexpr const char* kSimulateHelp =
    "A session with known truth: images, white images, target and truth.\n\n"
    "  plenocal simulate spec.yaml -o DIR\n\n"
    "then 'plenocal calibrate DIR/session.yaml -o OUT' can be compared with DIR/truth. docs/simulate.md describes the specification.";

void DeclareSimulate(CLI::App* app, SimulateRequest* request, ConsoleOptions* shared) {
  app->add_option("spec", request->spec, "spec.yaml: cameras, target, poses")->required();
  app->add_option("-o,--out", request->out, "folder for the session")->required();
  app->add_flag("--points", request->points, "detections with noise in place of images");
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command SimulateCommand() {
  return MakeCommand("simulate", kSimulateHelp, DeclareSimulate, RunSimulate);
}

}  // namespace plenocal
