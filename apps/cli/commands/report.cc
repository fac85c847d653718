// SPDX-License-Identifier: Apache-2.0
#include "apps/report/report.h"

#include <filesystem>

#include "apps/cli/options.h"
#include "calib/io/output_folder.h"
#include "engine/exchange/result_bundle.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {
namespace {

struct ReportArguments {
  std::filesystem::path folder;
  bool bundle = false, pictures = false;
};

OutputContents::value_type ReportFile(const ReportArguments& arguments) {
  const std::filesystem::path& folder = arguments.folder;
  if (arguments.bundle) return {"bundle.zip", ResultBundle(folder, arguments.pictures)};
  const CalibrationRecord calibration = OpenCalibrationFolder(folder);
  return {"report.html", ReportHtml(calibration, ReadCameraFiles(folder, calibration))};
}

void RunReport(const ReportArguments& arguments, Console* console) {
  console->PrintWritten(WriteInto(arguments.folder, {ReportFile(arguments)})[0]);
}

constexpr const char* kReportHelp =
    "The report of a calibration once more, from the files in its folder alone.\n\n"
    "  plenocal report OUT\n"
    "  plenocal report OUT --bundle\n\n"
    "writes OUT/report.html: one page that opens in any browser, without network. With --bundle it writes\n"
    "OUT/bundle.zip instead, for whoever looks for a fault: session, target, detections and result, which\n"
    "contain names of files and folders, but no images.";

void DeclareReport(CLI::App* app, ReportArguments* arguments, ConsoleOptions* shared) {
  app->add_option("out", arguments->folder, "folder that 'plenocal calibrate' wrote")->required();
  CLI::Option* const bundle =
      app->add_flag("--bundle", arguments->bundle, "an archive of session, detections and result");
  app->add_flag(
         "--pictures", arguments->pictures, "with --bundle: the folder's pictures and pages, too")
      ->needs(bundle);
  AddQuiet(app, shared);
}

}  // namespace

Command ReportCommand() { return MakeCommand("report", kReportHelp, DeclareReport, RunReport); }

}  // namespace plenocal
