// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/simulate.h"

#include <fmt/format.h>

#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/console.h"
#include "apps/cli/options.h"
#include "models/registry.h"

namespace plenocal {
namespace {

void RunSimulate(const SimulateRequest& request, const ConsoleOptions& shared) {
  Console console(shared);
  const std::string summary =
      Simulate(request,
               {.models = CameraModels(),
                .program = shared.program,
                .threads = shared.threads,
                .progress = [&](const std::string& stage, size_t done, size_t total) {
                  return console.Progress(stage, done, total);
                }});
  console.Print(fmt::format("{}written to {}\n", summary, request.out.string()));
}

constexpr const char* kSimulateHelp =
    "A session with known truth: images, white images, target and truth.\n\n"
    "  plenocal simulate spec.yaml -o DIR\n\n"
    "then 'plenocal calibrate DIR/session.yaml -o OUT' can be compared with DIR/truth. docs/simulate.md describes the specification.";

RunCommand DeclareSimulate(CLI::App* app, ConsoleOptions* shared) {
  const auto request = std::make_shared<SimulateRequest>();
  app->add_option("spec", request->spec, "spec.yaml: cameras, target, poses")->required();
  app->add_option("-o,--out", request->out, "folder for the session")->required();
  app->add_flag("--points", request->points, "detections with noise in place of images");
  AddThreadsAndQuiet(app, shared);
  return [request, shared] { RunSimulate(*request, *shared); };
}

}  // namespace

Command SimulateCommand() { return {"simulate", kSimulateHelp, DeclareSimulate}; }

}  // namespace plenocal
