// SPDX-License-Identifier: Apache-2.0

#include "apps/cli/options.h"
#include "apps/print/print_target.h"

namespace plenocal {
namespace {

void RunTarget(const PrintRequest& request, Console* console) {
  for (const std::filesystem::path& file : PrintTarget(request)) console->PrintWritten(file);
}

constexpr const char* kTargetHelp =
    "A printable target at true scale, with a ruler to check the printer.\n\n"
    "  plenocal target target.yaml -o FILE.svg|.pdf|.png\n"
    "  plenocal target chessboard:9x6:25mm -o FILE.pdf\n\n"
    "Tags that are arranged in space are laid out one by one, with ids and cut marks.";

void DeclareTarget(CLI::App* app, PrintRequest* request, ConsoleOptions* shared) {
  app->add_option("target", request->target, "target.yaml, or chessboard:9x6:25mm")->required();
  app->add_option("-o,--out", request->out, "FILE.svg, FILE.pdf or FILE.png")->required();
  app->add_option(
         "--paper", request->paper, "fit (as large as needed), a0 to a5, letter, legal or tabloid")
      ->capture_default_str();
  app->add_option("--dpi", request->dpi, "PNG: pixels per inch")
      ->check(CLI::Range(30.0, 2400.0))
      ->capture_default_str();
  app->add_flag(
      "--numbers", request->numbers, "draw markers' numbers and axes: to look at, not to print");
  AddQuiet(app, shared);
}

}  // namespace

Command TargetCommand() { return MakeCommand("target", kTargetHelp, DeclareTarget, RunTarget); }

}  // namespace plenocal
