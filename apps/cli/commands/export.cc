// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "engine/exchange/export_calibration.h"
#include "engine/formats/camera_format.h"

namespace plenocal {
namespace {

void RunExport(const ExportRequest& arguments, const ConsoleOptions& shared) {
  Console console(shared);
  for (const std::filesystem::path& path : ExportCalibration(arguments, console.NewRun())) {
    console.Print(fmt::format("written to {}\n", path.string()));
  }
}

std::string ExportHelp() {
  return fmt::format(
      "A calibration as another tool's file.\n\n"
      "  plenocal export calibration.yaml --format kalibr -o camchain.yaml\n\n"
      "Formats: {}; docs/exchange.md. Of tools with one file a camera, several become FILE_<camera>.",
      CameraFormatList());
}

RunCommand DeclareExport(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<ExportRequest>();
  app->add_option("calibration", arguments->calibration, "calibration.yaml")->required();
  app->add_option("--format", arguments->format, "the other tool")->required();
  app->add_option(
      "--camera", arguments->cameras, "cameras to export, in this order (default: all)");
  app->add_option("--response",
                  arguments->response,
                  "pcalib.txt of 'plenocal response', to be written beside (dso)");
  app->add_option(
         "-o,--out", arguments->out, "file to write, or a folder (colmap: with poses and points)")
      ->required();
  AddQuiet(app, shared);
  return [arguments, shared] { RunExport(*arguments, *shared); };
}

}  // namespace

Command ExportCommand() { return {"export", ExportHelp(), DeclareExport}; }

}  // namespace plenocal
