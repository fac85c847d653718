// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "apps/cli/options.h"
#include "engine/exchange/export_calibration.h"
#include "engine/formats/camera_format.h"

namespace plenocal {
namespace {

void RunExport(const ExportRequest& arguments, Console* console) {
  for (const std::filesystem::path& path : ExportCalibration(arguments, console->NewRun())) {
    console->PrintWritten(path);
  }
}

std::string ExportHelp() {
  return fmt::format(
      "A calibration as another tool's file.\n\n"
      "  plenocal export calibration.yaml --format kalibr -o camchain.yaml\n\n"
      "Formats: {}; docs/exchange.md. Of tools with one file a camera, several become FILE_<camera>.",
      CameraFormatList());
}

void DeclareExport(CLI::App* app, ExportRequest* arguments, ConsoleOptions* shared) {
  AddCalibration(app, &arguments->calibration);
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
}

}  // namespace

Command ExportCommand() { return MakeCommand("export", ExportHelp(), DeclareExport, RunExport); }

}  // namespace plenocal
