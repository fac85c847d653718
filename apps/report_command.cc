// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "apps/commands.h"
#include "apps/image_module.h"
#include "apps/report/report.h"
#include "calib/output_folder.h"

namespace plenocal {

void RunReport(const std::filesystem::path& folder) {
  const ResultFiles files = ReadResultFiles(folder);
  const std::string page = ReportHtml(files, folder.string(), ReadAttenuationMapByModule);
  OutputFolder out(folder);
  out.Write("report.html", page);
  out.Commit();
  fmt::print("written to {}\n", (folder / "report.html").string());
}

}  // namespace plenocal
