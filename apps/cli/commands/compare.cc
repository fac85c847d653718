// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "apps/cli/compared_files.h"
#include "apps/cli/options.h"
#include "apps/cli/result_pictures.h"
#include "assess/text/compare_text.h"
#include "calib/base/format_error.h"
#include "calib/base/json_text.h"
#include "engine/check_session.h"
#include "engine/json/calibration_json.h"

namespace plenocal {
namespace {

/// Two calibrations, attenuations or ground truths; or one calibration and new images.
struct CompareArguments : CheckRequest {
  std::filesystem::path other;  ///< empty: there are new images
  ImageArguments inputs;        ///< new images, or their session.yaml
  bool json = false;            ///< new images: JSON on standard output
};

/// The verdict on a calibration with new images; throws `Error` when it does not hold any more.
void CheckWithNewImages(const CompareArguments& arguments, Console* console) {
  const Run run = console->NewRun();
  const SessionCheck result =
      CheckSession(OpenInputs(arguments.inputs, "compare --check", run), arguments, run);
  const std::string json = JsonText(CheckJson(result.check)) + "\n";
  if (OutputFolder* const out = result.folders->out()) {
    out->Write("check.json", json);
    out->Write("difference.png", DifferencePicture(*result.comparison));
    result.folders->Commit();
  }
  const std::string in_space = result.space ? SpaceText(*result.space) : "";
  fmt::print("{}", arguments.json ? json : WithColours(CheckText(result.check) + in_space));
  if (result.check.valid) return;
  std::fflush(stdout);
  throw JobError(
      "{} does not hold for the images of {} any more; calibrate again",
      arguments.calibration.string(),
      arguments.inputs.images.empty() ? arguments.inputs.cameras[0] : arguments.inputs.images[0]);
}

void RunCompare(const CompareArguments& arguments, Console* console) {
  const bool is_check = !arguments.inputs.images.empty() || !arguments.inputs.cameras.empty();
  if (arguments.other.empty() != is_check) {
    throw InputError(
        "give either a second calibration.yaml or --check session.yaml; see 'plenocal compare --help'");
  }
  if (is_check) return CheckWithNewImages(arguments, console);
  if (arguments.json) {
    throw InputError("--json goes with --check; of two calibrations -o OUT writes compare.csv");
  }
  const auto out = OpenOutput(arguments.out);
  const ComparedFiles compared =
      CompareFilesOfAnyKind(arguments.calibration, arguments.other, arguments, out != nullptr);
  fmt::print("{}", WithColours(compared.text));
  if (!out) return;
  for (const auto& [name, content] : compared.files) out->Write(name, content);
  out->Commit();
  fmt::print("written to {}\n", arguments.out.string());
}

constexpr const char* kCompareHelp =
    "How far two calibrations differ in the image, beside the difference that their sigmas predict.\n"
    "\n"
    "  plenocal compare A/calibration.yaml B/calibration.yaml --space --distance 0.5 2\n"
    "  plenocal compare A/calibration.yaml --check session.yaml\n"
    "  plenocal compare A/calibration.yaml --check 'new/*.jpg' --target chessboard:9x6:25mm\n"
    "  plenocal compare A/vignetting_left.tiff B/vignetting_left.tiff\n"
    "  plenocal compare A/groundtruth.yaml B/groundtruth.yaml\n"
    "\n"
    "The rotation and translation of the camera frames that the difference of the intrinsics implies is removed first.";

void DeclareCompare(CLI::App* app, CompareArguments* arguments, ConsoleOptions* shared) {
  app->add_option("a",
                  arguments->calibration,
                  "calibration.yaml, an attenuation (TIFF), or groundtruth.yaml")
      ->required();
  app->add_option("b", arguments->other, "another, of any models");
  app->add_option(
         "--check",
         arguments->inputs.images,
         "instead of another: session.yaml with new images of the same cameras, or these images with --target. Does the calibration still hold for them (only poses free)? Exit status 1: no")
      ->expected(1)
      ->take_all();
  AddImageArguments(app, &arguments->inputs);
  app->add_option(
      "-o,--out",
      arguments->out,
      "folder for difference.png, compare.csv and compare_space.csv; of attenuations vignetting_compare.csv and a page, of ground truths groundtruth_compare.csv");
  app->add_option(
         "--map",
         arguments->map,
         "cameras of other names, separated by commas: left=cam0,right=cam1 for 'left' of the first file, or of the new images, that is 'cam0' in the other")
      ->delimiter(',');
  app->add_flag("--json", arguments->json, "with --check: JSON on standard output");
  AddThreads(app, shared);
  // Not FLOAT, which must be finite.
  app->add_option(
         "--distance", arguments->distances, "distances of the scene, m, or inf (default: 1 inf)")
      ->type_name("METRES")
      ->check([](const std::string& text) {
        const bool fits = std::strtod(text.c_str(), nullptr) > 0;
        return fits ? "" : "expected a positive number of metres, or inf, found " + text;
      });
  app->add_flag(
      "--space",
      arguments->in_space,
      "also the difference of points and lengths in space, at the finite ones of these distances");
  app->add_option("--bar", arguments->bar, "with --space: length that is compared, m")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  AddQuiet(app, shared);
}

}  // namespace

Command CompareCommand() {
  return MakeCommand("compare", kCompareHelp, DeclareCompare, RunCompare);
}

}  // namespace plenocal
