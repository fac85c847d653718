// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <optional>

#include "apps/cli/fleet/fleet_plan.h"
#include "apps/report/page_text.h"
#include "calib/base/error.h"
#include "calib/io/csv.h"
#include "calib/io/input_file.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

/// One calibration as the page shows it.
struct RunSummary {
  std::string date;
  std::string failure;  // last line of the log; empty: it was calibrated
  bool done = false;    // there is a status
  std::optional<Verdict> verdict;
  size_t points = 0, rejected = 0;
  double rms = 0;               // px, of the worst camera
  std::optional<double> drift;  // px, RMS against the date before, of the worst camera
  bool differs = false;         // more than both covariances predict
};

std::string TextAt(const fs::path& path) {
  std::error_code error;
  return fs::is_regular_file(path, error) ? ReadInput(path, InputLimit::kDocument) : std::string();
}

std::string LastLine(std::string text) {
  while (!text.empty() && text.back() == '\n') text.pop_back();
  const size_t at = text.rfind('\n');
  return at == std::string::npos ? text : text.substr(at + 1);
}

/// RMS difference over the image of the worst camera at the farthest distance of compare.csv.
void ReadDrift(const fs::path& folder, RunSummary* run) {
  const fs::path path = folder / "compare/compare.csv";
  const std::string text = TextAt(path);
  if (text.empty()) return;
  CsvReader table(text, path.string());
  const size_t part = table.Column("part"), rms = table.Column("rms"),
               differs = table.Column("differs");
  while (table.Next()) {
    run->differs |= table.Text(differs) == "1";  // of a part of the image; the row of all has none
    if (table.Text(part) != "all") continue;
    run->drift = std::max(run->drift.value_or(0), table.Number(rms));
  }
}

RunSummary Summarise(const fs::path& folder, const std::string& date) {
  RunSummary run{.date = date, .failure = {}, .verdict = {}, .drift = {}};
  const std::string status = LastLine(TextAt(folder / "status.txt"));
  run.done = !status.empty();
  if (!run.done) return run;
  if (status != "0") {
    run.failure = LastLine(TextAt(folder / "calibrate.log"));
    if (run.failure.empty()) run.failure = "exit status " + status;
    return run;
  }
  try {
    const CalibrationRecord record = OpenCalibration(folder / "result/calibration.yaml");
    run.verdict = record.verdict;
    for (const CalibratedCamera& camera : record.cameras) {
      run.points += static_cast<size_t>(camera.fit.points);
      run.rejected += static_cast<size_t>(camera.fit.rejected);
      run.rms = std::max(run.rms, camera.fit.rms);
    }
    ReadDrift(folder, &run);
  } catch (const Error& error) {
    run.failure = error.what();
  }
  return run;
}

/// The latest drift, px, and those over the dates as bars, in red beyond the prediction.
std::string DriftChart(const std::vector<RunSummary>& runs) {
  constexpr double kBar = 14, kHeight = 36;
  double largest = 1e-3;
  for (const RunSummary& run : runs) largest = std::max(largest, run.drift.value_or(0));
  std::string svg = fmt::format(
      "<svg width=\"{:.0f}\" height=\"{:.0f}\">", kBar * static_cast<double>(runs.size()), kHeight);
  for (size_t i = 0; i < runs.size(); ++i) {
    if (!runs[i].drift) continue;
    const double height = std::max(1.0, kHeight * *runs[i].drift / largest);
    svg += fmt::format(
        "<rect x=\"{:.0f}\" y=\"{:.1f}\" width=\"{:.0f}\" height=\"{:.1f}\" class=\"{}\"><title>{}: {:.3f} px</title></rect>",
        kBar * static_cast<double>(i),
        kHeight - height,
        kBar - 2,
        height,
        runs[i].differs ? "beyond" : "within",
        HtmlText(runs[i].date),
        *runs[i].drift);
  }
  svg += "</svg>";
  return runs.back().drift ? fmt::format("{:.3f} {}", *runs.back().drift, svg) : svg;
}

struct RigSummary {
  std::string name;
  std::vector<RunSummary> runs;
  std::string advice;  // empty: nothing is to be done
};

/// Advice about a rig, by its latest calibration.
std::string AdviceOn(const std::vector<RunSummary>& runs) {
  const RunSummary& last = runs.back();
  if (!last.done) return "not calibrated yet";
  if (!last.failure.empty()) return "record again: " + last.failure;
  if (last.verdict && last.verdict->grade == Grade::kBad) {
    return "record again: " +
           (last.verdict->findings.empty() ? std::string("bad") : last.verdict->findings[0].what);
  }
  if (last.differs) {
    return fmt::format(
        "use the new calibration: it differs from the one before by {:.2g} px, more than both predict",
        last.drift.value_or(0));
  }
  return {};
}

std::string Row(const RigSummary& rig) {
  const RunSummary& last = rig.runs.back();
  const std::string grade = !last.done              ? ""
                            : !last.failure.empty() ? "failed"
                            : last.verdict          ? std::string(GradeName(last.verdict->grade))
                                                    : "";
  const std::string link = last.done && last.failure.empty()
                               ? fmt::format("<a href=\"{0}/{1}/result/report.html\">{1}</a>",
                                             HtmlText(rig.name),
                                             HtmlText(last.date))
                               : HtmlText(last.date);
  return fmt::format(
      "<tr><td>{}</td><td>{}</td><td>{}</td><td class=\"{}\">{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
      HtmlText(rig.name),
      rig.runs.size(),
      link,
      grade,
      grade,
      last.failure.empty() && last.done ? fmt::format("{:.3f}", last.rms) : "",
      last.points > 0 ? fmt::format("{} of {}", last.rejected, last.points + last.rejected) : "",
      DriftChart(rig.runs),
      HtmlText(rig.advice));
}

constexpr const char* kPage = R"HTML(<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Fleet</title><style>
body {{ font: 15px/1.4 system-ui, sans-serif; margin: 2em; color: #222 }}
table {{ border-collapse: collapse }} td, th {{ padding: .3em .8em; border-bottom: 1px solid #ddd; text-align: left; vertical-align: middle }}
td:nth-child(-n+7) {{ white-space: nowrap }}
svg {{ vertical-align: middle }}
.good {{ color: #176b2c }} .usable {{ color: #8a5a00 }} .bad, .failed {{ color: #b00020; font-weight: 600 }}
rect.within {{ fill: #7a9cc6 }} rect.beyond {{ fill: #c0392b }}
</style></head><body>
<h1>{} rigs, {} calibrations</h1>
<p>{} good, {} usable, {} bad, {} failed, {} open. <b>{} to act on</b>, listed first.</p>
<p>Drift: RMS difference in the image between a calibration and the one before, of the worst camera and distance; red where it is more than the standard errors of both predict.</p>
<table><tr><th>rig</th><th>dates</th><th>latest</th><th>verdict</th><th>RMS, px</th><th>rejected points</th><th>drift, px</th><th>to do</th></tr>
{}</table></body></html>
)HTML";

}  // namespace

std::string FleetPage(const FleetPlan& plan, const fs::path& results) {
  std::vector<RigSummary> rigs;
  size_t runs = 0, failed = 0, open = 0, to_do = 0;
  std::array<size_t, 3> grades{};
  for (const FleetRig& rig : plan.rigs) {
    RigSummary& summary = rigs.emplace_back(RigSummary{.name = rig.name, .runs = {}, .advice = {}});
    for (const FleetRun& run : rig.runs) {
      summary.runs.push_back(Summarise(results / rig.name / run.date, run.date));
      const RunSummary& now = summary.runs.back();
      ++runs;
      open += now.done ? 0 : 1;
      failed += now.done && !now.failure.empty() ? 1 : 0;
      if (now.verdict) ++grades[static_cast<size_t>(now.verdict->grade)];
    }
    summary.advice = AdviceOn(summary.runs);
    to_do += summary.advice.empty() ? 0 : 1;
  }
  std::ranges::stable_sort(rigs, {}, [](const RigSummary& rig) { return rig.advice.empty(); });
  std::string rows;
  for (const RigSummary& rig : rigs) rows += Row(rig);
  return fmt::format(
      kPage, rigs.size(), runs, grades[0], grades[1], grades[2], failed, open, to_do, rows);
}

}  // namespace plenocal
