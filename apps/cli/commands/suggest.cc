// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <cmath>
#include <optional>
#include <string_view>

#include "apps/cli/options.h"
#include "apps/suggest/suggestions_json.h"
#include "apps/suggest/view_sheet.h"
#include "calib/base/format_error.h"
#include "calib/base/json_text.h"
#include "calib/base/number_text.h"
#include "calib/io/output_folder.h"
#include "engine/suggest_views.h"

namespace plenocal {
namespace {

struct SuggestArguments : SuggestRequest {
  std::string goal_words;  ///< "0.05", "depth@5m", "depth@5m:2mm"
  bool json = false;
  std::filesystem::path picture;  ///< empty: none
  /// Pictures taken at once that are to be weighed, "left=look.png"; empty: views are suggested.
  std::vector<std::string> images;
};

// By camera; one without a name is the calibration's only camera.
std::map<std::string, FrameImage> PicturesOf(const SuggestArguments& arguments) {
  std::map<std::string, FrameImage> pictures;
  for (const std::string& word : arguments.images) {
    const size_t equals = word.find('=');
    const std::string camera = equals == std::string::npos ? "" : word.substr(0, equals);
    const std::filesystem::path path = word.substr(equals == std::string::npos ? 0 : equals + 1);
    if (path.empty()) {
      throw InputError("--image: '{}' names no file", word);
    }
    if (!pictures.emplace(camera, FrameImage{.frame = path.stem().string(), .path = path}).second) {
      throw InputError("--image: two pictures of camera '{}'; give one", camera);
    }
  }
  return pictures;
}

// Sets goal and depth_at.
void ReadGoal(const std::string& words, SuggestRequest* request) {
  constexpr std::string_view kDepth = "depth@";
  constexpr double kMillimetres = 1e3, kPartOfDistance = 1e-3;
  const auto length = [&](std::string_view text) {
    const std::optional<Length> read = ParseLength(text);
    if (read && read->metres > 0) return read->metres;
    throw InputError("--goal {}: expected px above 0, as 0.05, or depth@5m, or depth@5m:2mm",
                     words);
  };
  if (words.empty()) return;
  if (!words.starts_with(kDepth)) {
    const std::optional<double> px = ParseDouble(words);
    request->goal = px && std::isfinite(*px) && *px > 0 ? *px : length("");
    return;
  }
  const std::string_view rest = std::string_view(words).substr(kDepth.size());
  const size_t colon = rest.find(':');
  request->depth_at = length(rest.substr(0, colon));
  request->goal =
      kMillimetres * (colon == std::string_view::npos ? kPartOfDistance * request->depth_at
                                                      : length(rest.substr(colon + 1)));
}

void RunSuggest(SuggestArguments arguments, Console* console) {
  ReadGoal(arguments.goal_words, &arguments);
  const Run run = console->NewRun();
  if (!arguments.images.empty()) {
    const PictureGain gain = EvaluatePictures(arguments.input, PicturesOf(arguments), run);
    if (arguments.json) return fmt::print("{}\n", JsonText(PictureGainJson(gain)));
    return console->Print(PictureGainText(gain) + "\n");
  }
  std::optional<PictureFormat> format;
  if (!arguments.picture.empty()) format = PictureFormatOf(arguments.picture);
  const SuggestedViews suggested = SuggestViews(arguments, run);
  if (format) {
    WriteOutput(arguments.picture,
                DrawViewSheet(suggested.views, suggested.rig, suggested.shape, *format));
  }
  if (!arguments.json) {
    const bool assumed_angle = arguments.angle > 0;
    return console->Print(
        NextViewsText(suggested.views, suggested.rig, suggested.verdict, assumed_angle));
  }
  fmt::print("{}\n", JsonText(SuggestionsJson(suggested)));
}

constexpr const char* kSuggestHelp =
    "What to record next: the poses of the target that lower the projection's sigma most.\n\n"
    "  plenocal suggest OUT\n"
    "  plenocal suggest session.yaml --picture next.svg\n"
    "  plenocal suggest OUT --image left=now.png\n"
    "  plenocal suggest --target chessboard:9x6:25mm --size 1280x960 --angle 70\n\n"
    "OUT is the folder that 'plenocal calibrate' wrote. The last form is for the time before the first image. docs/suggest.md explains the choice.";

void DeclareSuggest(CLI::App* app, SuggestArguments* arguments, ConsoleOptions* shared) {
  app->add_option("input",
                  arguments->input,
                  "folder that 'plenocal calibrate' wrote, or session.yaml; none: no image yet");
  app->add_option(
      "--target", arguments->target, "before the first image: chessboard:9x6:25mm, or a file");
  AddImageSize(app, &arguments->size, "before the first image: size of images, 1280x960");
  app->add_option(
         "--angle",
         arguments->angle,
         "horizontal field of view of the lens, degrees, of the data sheet: before the first image, and while images do not determine it")
      ->check(CLI::Range(1.0, 300.0));
  app->add_option("--model", arguments->model, "before the first image: camera model")
      ->capture_default_str();
  app->add_option("--count", arguments->count, "number of suggestions")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  app->add_option("--near", arguments->nearest, "least distance of the target, m")
      ->check(CLI::PositiveNumber);
  app->add_option("--far", arguments->farthest, "largest distance of the target, m")
      ->check(CLI::PositiveNumber);
  app->add_option("--tilt", arguments->tilt, "largest tilt against the line of sight, degrees")
      ->check(CLI::Range(0.0, 75.0))
      ->capture_default_str();
  app->add_option(
         "--goal",
         arguments->goal_words,
         "sigma of the projection that suffices, px; or depth@5m, depth@5m:2mm: sigma of z "
         "at 5 m (by default a thousandth of the distance)")
      ->default_str("0.05");
  app->add_option("--picture", arguments->picture, "FILE.svg or FILE.png: what images should show");
  app->add_option(
      "--image",
      arguments->images,
      "[CAMERA=]FILE: a picture (of a rig one of each camera, taken at once); what it adds, against what the best view would");
  app->add_flag("--json", arguments->json, "the suggestions as JSON on standard output");
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command SuggestCommand() {
  return MakeCommand("suggest", kSuggestHelp, DeclareSuggest, RunSuggest);
}

}  // namespace plenocal
