// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "apps/cli/options.h"
#include "apps/cli/triangulated_inputs.h"
#include "calib/base/format_error.h"
#include "engine/rigs/triangulate_points.h"

namespace plenocal {
namespace {

struct TriangulateArguments : TriangulateRequest {
  std::vector<std::string> given;  // CAMERA=FILE, or a session
  std::vector<std::string> places, length, angle, plane;
  bool json = false;
};

std::vector<std::vector<ScenePosition>> PositionsOf(const std::vector<std::string>& words,
                                                    const char* option) {
  std::vector<std::vector<ScenePosition>> sets;
  for (const std::string& word : words) {
    std::vector<ScenePosition>& ends = sets.emplace_back();
    for (std::string part : CLI::detail::split(word, ',')) {
      try {
        ends.push_back(PositionNamed(CLI::detail::trim(part)));
      } catch (const Error& error) {
        throw InputError("{} {}: {}", option, word, error.what());
      }
    }
  }
  return sets;
}

// "left:612.3,401.2"
PickedPoint PlaceOf(const std::string& word) {
  PickedPoint place;
  const size_t colon = word.rfind(':');
  const std::string numbers = colon == std::string::npos ? "" : word.substr(colon + 1);
  const size_t comma = numbers.find(',');
  if (comma == std::string::npos || !CLI::detail::lexical_cast(numbers.substr(0, comma), place.x) ||
      !CLI::detail::lexical_cast(numbers.substr(comma + 1), place.y) || !std::isfinite(place.x) ||
      !std::isfinite(place.y)) {
    throw InputError("--at {}: expected a camera and a place in its image, as left:612.3,401.2",
                     word);
  }
  place.camera = word.substr(0, colon);
  return place;
}

TriangulateRequest RequestOf(const TriangulateArguments& arguments) {
  TriangulateRequest request = arguments;
  for (const std::string& word : arguments.places) request.at.push_back(PlaceOf(word));
  request.lengths = PositionsOf(arguments.length, "--length");
  request.angles = PositionsOf(arguments.angle, "--angle");
  request.planes = PositionsOf(arguments.plane, "--plane");
  return request;
}

void RunTriangulate(const TriangulateArguments& arguments, Console* console) {
  const Triangulation made =
      TriangulateGiven(arguments.given, RequestOf(arguments), console->NewRun());
  console->Print(arguments.json ? TriangulationJson(made) : TriangulationText(made));
}

constexpr const char* kTriangulateHelp =
    "Points in space from their images, with what noise and the calibration leave uncertain.\n"
    "\n"
    "  plenocal triangulate OUT left=left.csv right=right.csv --length 12,40 -o DIR\n"
    "  plenocal triangulate OUT plenoptic=detections_plenoptic.csv -o DIR\n"
    "  plenocal triangulate OUT session.yaml --length 'tag 3,tag 12 corner 0'\n"
    "  plenocal triangulate OUT left=a.png right=b.png --at left:612.3,401.2 --at left:700,400 --length 0,1\n"
    "\n"
    "Tables have the columns frame, marker, x, y (detections); of a session the target's markers are detected. Writes points.csv, shared.csv (errors common to all points), measures.csv and triangulation.yaml; docs/space.md.";

void DeclareTriangulate(CLI::App* app, TriangulateArguments* arguments, ConsoleOptions* shared) {
  app->add_option("calibration",
                  arguments->calibration,
                  "folder that 'plenocal calibrate' wrote, or its calibration.yaml")
      ->required();
  app->add_option("points",
                  arguments->given,
                  "CAMERA=POINTS.csv of each camera; a session.yaml with new images of its target; "
                  "with --at CAMERA=IMAGE")
      ->required();
  app->add_option("--at",
                  arguments->places,
                  "a place in one image, left:612.3,401.2, to be found in the others: point 0, of "
                  "the next --at point 1, ...");
  app->add_option("--length",
                  arguments->length,
                  "two points: 12,40, or 'tag 3,tag 7 corner 0'; may be repeated");
  app->add_option("--angle", arguments->angle, "three points, the second is the corner: 1,2,3");
  app->add_option("--plane", arguments->plane, "three points or more: 1,2,3,7");
  app->add_flag("--all-lengths", arguments->all_lengths, "between all points of a frame");
  AddSpaceFrame(app, &arguments->frame);
  app->add_option(
         "--sigma", arguments->sigma, "noise of each coordinate, px (default: the calibration's)")
      ->check(CLI::PositiveNumber);
  app->add_option("--correlation",
                  arguments->correlation,
                  "of the noise of two ordinary cameras in the same coordinate, for points matched "
                  "from image to image")
      ->check(CLI::Range(-1.0, 1.0));
  app->add_flag(
      "--adjust",
      arguments->adjust,
      "adjust the calibration, too, within its standard errors, by the rays of all points");
  app->add_option("--level", arguments->level, "of intervals")
      ->check(CLI::Range(0.5, 0.9999))
      ->capture_default_str();
  app->add_option("-o,--out", arguments->out, "folder for the results");
  AddJson(app, &arguments->json);
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command TriangulateCommand() {
  return MakeCommand("triangulate", kTriangulateHelp, DeclareTriangulate, RunTriangulate);
}

}  // namespace plenocal
