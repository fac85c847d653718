// SPDX-License-Identifier: Apache-2.0
#include "apps/report/report.h"

#include <fmt/format.h>

#include <filesystem>
#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "calib/io/output_folder.h"
#include "models/registry.h"

namespace plenocal {
namespace {

void RunReport(const std::filesystem::path& folder, const ConsoleOptions& shared) {
  const CalibrationRecord calibration = ReadCalibrationFolder(folder, CameraModels());
  const std::string page = ReportHtml(calibration, ReadCameraFiles(folder, calibration));
  const auto written = WriteInto(folder, {{"report.html", page}});
  Console(shared).Print(fmt::format("written to {}\n", written[0].string()));
}

constexpr const char* kReportHelp =
    "The report of a calibration once more, from the files in its folder alone.\n\n"
    "  plenocal report OUT\n\n"
    "writes OUT/report.html: one page that opens in any browser, without network.";

RunCommand DeclareReport(CLI::App* app, ConsoleOptions* shared) {
  const auto folder = std::make_shared<std::filesystem::path>();
  app->add_option("out", *folder, "folder that 'plenocal calibrate' wrote")->required();
  AddQuiet(app, shared);
  return [folder, shared] { RunReport(*folder, *shared); };
}

}  // namespace

Command ReportCommand() { return {"report", kReportHelp, DeclareReport}; }

}  // namespace plenocal
