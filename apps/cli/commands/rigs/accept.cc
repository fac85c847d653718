// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "apps/cli/options.h"
#include "apps/cli/triangulated_inputs.h"
#include "apps/report/acceptance_page.h"
#include "calib/base/error.h"
#include "calib/base/json_text.h"
#include "calib/io/input_file.h"
#include "engine/rigs/accept_lengths.h"

namespace plenocal {
namespace {

struct AcceptArguments {
  TriangulateRequest request;
  std::filesystem::path bars, out;
  std::vector<std::string> given;  // CAMERA=FILE, or a session
  bool json = false;
};

void RunAccept(const AcceptArguments& arguments, Console* console) {
  const RunScope inputs;
  const AcceptanceTest test = ReadAcceptanceTest(arguments.bars);
  const std::unique_ptr<OutputFolder> out = OpenOutput(arguments.out);
  const Acceptance acceptance =
      AcceptLengths(test, TriangulateGiven(arguments.given, arguments.request, console->NewRun()));
  if (out) {
    for (const auto& [name, text] : AcceptanceFiles(acceptance)) out->Write(name, text);
    out->Write("acceptance.html", AcceptancePage(acceptance));
    out->Commit();
  }
  console->Print(arguments.json ? JsonText(AcceptanceJson(acceptance)) + "\n"
                                : AcceptanceText(acceptance));
  if (acceptance.passes) return;
  std::fflush(stdout);
  throw Error(ErrorKind::kGrade,
              fmt::format("a length deviates by more than {} allows", arguments.bars.string()));
}

constexpr const char* kAcceptHelp =
    "Acceptance test of a calibration: lengths that are known against the same lengths as it measures them, after VDI/VDE 2634 part 1. Exit status 3: it fails.\n"
    "\n"
    "  plenocal accept OUT bars.yaml session.yaml -o DIR\n"
    "  plenocal accept OUT bars.yaml left=left.csv right=right.csv -o DIR\n"
    "\n"
    "bars.yaml has the limit and the lengths. Each frame is a measurement by itself. Writes acceptance.csv, acceptance.json and acceptance.html; docs/space.md.";

void DeclareAccept(CLI::App* app, AcceptArguments* arguments, ConsoleOptions* shared) {
  app->add_option("calibration",
                  arguments->request.calibration,
                  "folder that 'plenocal calibrate' wrote, or its calibration.yaml")
      ->required();
  app->add_option("bars", arguments->bars, "bars.yaml: limit and lengths")->required();
  app->add_option("points",
                  arguments->given,
                  "CAMERA=POINTS.csv of each camera, or a session.yaml with images of its target")
      ->required();
  app->add_option("-o,--out", arguments->out, "folder for the results");
  AddJson(app, &arguments->json);
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command AcceptCommand() { return MakeCommand("accept", kAcceptHelp, DeclareAccept, RunAccept); }

}  // namespace plenocal
