// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <numbers>

#include "apps/cli/options.h"
#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "calib/base/statistics.h"
#include "engine/rigs/triangulate_points.h"

namespace plenocal {
namespace {

struct TriangulateArguments : TriangulateRequest {
  std::vector<std::string> given;  // CAMERA=FILE
  std::string frame_name = "rig";
  std::vector<std::string> length, angle, plane;
};

std::vector<std::vector<int>> NumbersOf(const std::vector<std::string>& words, const char* option) {
  std::vector<std::vector<int>> sets;
  for (const std::string& word : words) {
    std::vector<int>& numbers = sets.emplace_back();
    for (const std::string& part : CLI::detail::split(word, ',')) {
      int number = 0;
      if (!CLI::detail::lexical_cast(part, number)) {
        throw InputError("{} {}: expected numbers of points, as 12,40", option, word);
      }
      numbers.push_back(number);
    }
  }
  return sets;
}

TriangulateRequest RequestOf(const TriangulateArguments& arguments) {
  TriangulateRequest request = arguments;
  for (const std::string& word : arguments.given) {
    const size_t equals = word.find('=');
    if (equals == std::string::npos || equals == 0) {
      throw InputError("{}: expected a camera and its table, as left=left.csv", word);
    }
    request.tables.emplace_back(word.substr(0, equals), word.substr(equals + 1));
  }
  request.frame = arguments.frame_name == "housing" ? SpaceFrame::kHousing : SpaceFrame::kRig;
  request.lengths = NumbersOf(arguments.length, "--length");
  request.angles = NumbersOf(arguments.angle, "--angle");
  request.planes = NumbersOf(arguments.plane, "--plane");
  return request;
}

// Medians over the points that are not at infinity.
std::string SpreadText(const Triangulation& made) {
  std::vector<double> sigma, noise, calibration;
  for (const TriangulatedPoint& each : made.points) {
    if (!each.used || !(each.point.rho > 0)) continue;
    sigma.push_back(std::sqrt(each.point.Covariance()(2, 2)));
    noise.push_back(std::sqrt(each.point.noise(2, 2)));
    calibration.push_back(each.point.shared.row(2).norm());
  }
  if (sigma.empty()) return "all at infinity";
  return fmt::format("sigma of z {:.2g} mm (noise {:.2g}, calibration {:.2g}; medians)",
                     1e3 * Median(sigma),
                     1e3 * Median(noise),
                     1e3 * Median(calibration));
}

std::string MeasureText(const TriangulatedMeasure& measure) {
  const std::string name =
      fmt::format("{}: {} {}: ", Escaped(measure.frame), measure.kind, measure.of);
  if (measure.plane) {
    if (measure.plane->degrees < 0) return name + "no plane: the points lie on a line\n";
    return name + fmt::format("{:.3g} mm RMS from the plane, chi-square {:.3g} of {} degrees\n",
                              1e3 * measure.plane->rms,
                              measure.plane->chi_square,
                              measure.plane->degrees);
  }
  const bool is_angle = measure.kind == "angle";
  const double unit = is_angle ? 180 / std::numbers::pi : 1e3;
  const Measured& number = *measure.number;
  return name + fmt::format("{:.6g} +- {:.2g} {} (noise {:.2g}, calibration {:.2g})\n",
                            unit * number.value,
                            unit * number.Sigma(),
                            is_angle ? "degrees" : "mm",
                            unit * number.noise,
                            unit * number.calibration);
}

void RunTriangulate(const TriangulateArguments& arguments, Console* console) {
  const TriangulateRequest request = RequestOf(arguments);
  const Triangulation made = TriangulatePoints(request, console->NewRun());
  const auto used = std::ranges::count_if(made.points, &TriangulatedPoint::used);
  std::string text = fmt::format("{}: {} points, {} left out; {}\n",
                                 fmt::join(made.cameras, " + "),
                                 used,
                                 made.points.size() - static_cast<size_t>(used),
                                 SpreadText(made));
  constexpr size_t kMostLines = 20;
  for (size_t i = 0; i < made.measures.size() && i < kMostLines; ++i) {
    text += MeasureText(made.measures[i]);
  }
  if (made.measures.size() > kMostLines) {
    text += fmt::format("and {} more in measures.csv\n", made.measures.size() - kMostLines);
  }
  for (size_t i = 0; i < made.left_out.size() && i < kMostLines; ++i) {
    text +=
        fmt::format("left out: {}: {}\n", Escaped(made.left_out[i].where), made.left_out[i].reason);
  }
  for (const Finding& finding : made.findings) {
    text += fmt::format("{} [{}] {}\n    {}\n",
                        GradeName(finding.grade),
                        finding.code,
                        finding.what,
                        finding.remedy);
  }
  console->Print(text);
}

constexpr const char* kTriangulateHelp =
    "Points in space from their images, with what noise and the calibration leave uncertain.\n"
    "\n"
    "  plenocal triangulate OUT left=left.csv right=right.csv --length 12,40 -o DIR\n"
    "  plenocal triangulate OUT plenoptic=detections_plenoptic.csv -o DIR\n"
    "\n"
    "Tables have the columns frame, marker, x, y (detections). Writes points.csv, shared.csv (errors common to all points), measures.csv and triangulation.yaml; docs/space.md.";

void DeclareTriangulate(CLI::App* app, TriangulateArguments* arguments, ConsoleOptions* shared) {
  app->add_option("calibration",
                  arguments->calibration,
                  "folder that 'plenocal calibrate' wrote, or its calibration.yaml")
      ->required();
  app->add_option("tables", arguments->given, "CAMERA=POINTS.csv of each camera")->required();
  app->add_option("--length", arguments->length, "two points: 12,40; may be repeated");
  app->add_option("--angle", arguments->angle, "three points, the second is the corner: 1,2,3");
  app->add_option("--plane", arguments->plane, "three points or more: 1,2,3,7");
  app->add_flag("--all-lengths", arguments->all_lengths, "between all points of a frame");
  app->add_option("--frame",
                  arguments->frame_name,
                  "errors in the first camera's frame, or less the motion that the calibration's "
                  "own points follow")
      ->check(CLI::IsMember({"rig", "housing"}))
      ->capture_default_str();
  app->add_option(
         "--sigma", arguments->sigma, "noise of each coordinate, px (default: the calibration's)")
      ->check(CLI::PositiveNumber);
  app->add_option("--level", arguments->level, "of intervals")
      ->check(CLI::Range(0.5, 0.9999))
      ->capture_default_str();
  app->add_option("-o,--out", arguments->out, "folder for the results");
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command TriangulateCommand() {
  return MakeCommand("triangulate", kTriangulateHelp, DeclareTriangulate, RunTriangulate);
}

}  // namespace plenocal
