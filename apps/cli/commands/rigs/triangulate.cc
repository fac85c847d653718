// SPDX-License-Identifier: Apache-2.0

#include "apps/cli/options.h"
#include "calib/base/format_error.h"
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

void RunTriangulate(const TriangulateArguments& arguments, Console* console) {
  console->Print(TriangulationText(TriangulatePoints(RequestOf(arguments), console->NewRun())));
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
