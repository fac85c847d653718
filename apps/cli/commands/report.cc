// SPDX-License-Identifier: Apache-2.0
#include "apps/report/report.h"

#include <filesystem>

#include "apps/cli/options.h"
#include "calib/io/output_folder.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {
namespace {

void RunReport(const std::filesystem::path& folder, Console* console) {
  const CalibrationRecord calibration = OpenCalibrationFolder(folder);
  const std::string page = ReportHtml(calibration, ReadCameraFiles(folder, calibration));
  const auto written = WriteInto(folder, {{"report.html", page}});
  console->PrintWritten(written[0]);
}

constexpr const char* kReportHelp =
    "The report of a calibration once more, from the files in its folder alone.\n\n"
    "  plenocal report OUT\n\n"
    "writes OUT/report.html: one page that opens in any browser, without network.";

void DeclareReport(CLI::App* app, std::filesystem::path* folder, ConsoleOptions* shared) {
  app->add_option("out", *folder, "folder that 'plenocal calibrate' wrote")->required();
  AddQuiet(app, shared);
}

}  // namespace

Command ReportCommand() { return MakeCommand("report", kReportHelp, DeclareReport, RunReport); }

}  // namespace plenocal
