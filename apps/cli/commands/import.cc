// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "engine/exchange/import_files.h"
#include "engine/formats/import_format.h"

namespace plenocal {
namespace {

void RunImport(const ImportRequest& arguments, const ConsoleOptions& shared) {
  Console console(shared);
  const std::filesystem::path written = ImportFiles(arguments, console.NewRun());
  console.Print(fmt::format("written to {}\n", written.string()));
}

std::string ImportHelp() {
  return fmt::format(
      "Another tool's file as one of plenocal.\n\n"
      "  plenocal import camchain.yaml --format kalibr -o OUT\n\n"
      "Formats: those of 'plenocal export' give OUT/calibration.yaml; {}.",
      ImportFormatList());
}

RunCommand DeclareImport(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<ImportRequest>();
  app->add_option("file", arguments->files, "the other tool's file; of mrcal one a camera")
      ->required();
  app->add_option("--format", arguments->format, "the other tool")->required();
  AddImageSize(app, &arguments->size, "WIDTHxHEIGHT of the images where the file does not hold it");
  app->add_flag("--fisheye",
                arguments->fisheye,
                "opencv: the coefficients are cv::fisheye's where the file does not mark them");
  app->add_option("-o,--out", arguments->out, "folder, or the file to write")->required();
  AddQuiet(app, shared);
  return [arguments, shared] { RunImport(*arguments, *shared); };
}

}  // namespace

Command ImportCommand() { return {"import", ImportHelp(), DeclareImport}; }

}  // namespace plenocal
