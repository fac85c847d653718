// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "apps/cli/options.h"
#include "engine/exchange/import_files.h"
#include "engine/formats/import_format.h"

namespace plenocal {
namespace {

void RunImport(const ImportRequest& arguments, Console* console) {
  const std::filesystem::path written = ImportFiles(arguments, console->NewRun());
  console->PrintWritten(written);
}

std::string ImportHelp() {
  return fmt::format(
      "Another tool's file as one of plenocal.\n\n"
      "  plenocal import camchain.yaml --format kalibr -o OUT\n\n"
      "Formats: those of 'plenocal export' give OUT/calibration.yaml; {}.",
      ImportFormatList());
}

void DeclareImport(CLI::App* app, ImportRequest* arguments, ConsoleOptions* shared) {
  app->add_option("file", arguments->files, "the other tool's file; of mrcal one a camera")
      ->required();
  app->add_option("--format", arguments->format, "the other tool")->required();
  AddImageSize(app, &arguments->size, "WIDTHxHEIGHT of the images where the file does not hold it");
  app->add_flag("--fisheye",
                arguments->fisheye,
                "opencv: the coefficients are cv::fisheye's where the file does not mark them");
  app->add_option("-o,--out", arguments->out, "folder, or the file to write")->required();
  AddQuiet(app, shared);
}

}  // namespace

Command ImportCommand() { return MakeCommand("import", ImportHelp(), DeclareImport, RunImport); }

}  // namespace plenocal
