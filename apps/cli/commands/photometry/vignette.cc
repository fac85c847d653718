// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>
#include <optional>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "apps/photometry/exposed_images.h"
#include "apps/photometry/vignette_files.h"
#include "calib/base/error.h"
#include "calib/files/calibration_file.h"
#include "calib/io/output_folder.h"
#include "detectors/images/image.h"
#include "engine/recording/stores/image_lister.h"
#include "engine/resample/resample_images.h"
#include "models/registry.h"

namespace plenocal {
namespace {

struct VignetteArguments {
  std::filesystem::path recording;
  std::string camera;                 ///< empty: the only one
  std::filesystem::path calibration;  ///< empty: that of the recording
  std::filesystem::path response;     ///< pcalib.txt; empty: that of the recording, or linear
  std::filesystem::path target;
  std::vector<std::string> white;  ///< images to compare with; empty: those of the recording
  std::filesystem::path out;
};

CalibrationRecord ReadCalibrationFor(const VignetteArguments& arguments,
                                     const Recording& recording) {
  const std::filesystem::path& path =
      arguments.calibration.empty() ? recording.calibration : arguments.calibration;
  if (!path.empty()) return ReadCalibration(path, CameraModels());
  throw Error(ErrorKind::kInput,
              fmt::format("{}: names no calibration; give --calibration calibration.yaml",
                          recording.path.string()));
}

void RunVignette(const VignetteArguments& arguments, const ConsoleOptions& shared) {
  Console console(shared);
  console.Progress("read " + arguments.recording.string());
  const Recording recording = ReadRecording(arguments.recording);
  const RecordedCamera& images = ChooseRecordedCamera(recording, arguments.camera);
  const CalibrationRecord calibration = ReadCalibrationFor(arguments, recording);
  const CalibratedCamera& camera = FindCamera(calibration, images.name);
  if (camera.model->plenoptic) {
    throw Error(ErrorKind::kInput,
                fmt::format("camera '{}' is plenoptic: its vignetting is that of micro images; use "
                            "'plenocal white'",
                            camera.name));
  }
  const Target target = ReadTarget(arguments.target);
  const std::filesystem::path& response =
      arguments.response.empty() ? images.response : arguments.response;
  OutputFolder output(arguments.out);
  WallOptions options{.recording = &recording,
                      .images = &images,
                      .camera = &camera,
                      .response = response.empty() ? ResponseCurve() : ReadResponse(response),
                      .target = &target,
                      .threads = shared.threads,
                      .progress = [&](size_t done, size_t total) {
                        return console.Progress(images.name + ": images", done, total);
                      }};
  WallRecording wall = ReadWall(options);
  for (const LeftOut& item : wall.left_out) {
    console.Message(fmt::format("  left out {}: {}", item.where, item.reason));
  }
  if (response.empty()) {
    console.Warning(
        "no response is known: grey values count as proportional to the light; measure it with "
        "'plenocal response' and give --response pcalib.txt");
  }
  if (!wall.exposures_known) {
    console.Warning("exposure times are not known: the brightness of each image is estimated too");
  }
  const bool exposures_known = wall.exposures_known;
  std::vector<std::string> frames;
  std::vector<double> exposures;
  for (const WallView& view : wall.views) {
    frames.push_back(view.frame);
    exposures.push_back(view.exposure);
  }
  const VignetteEstimate estimate =
      FitVignette(std::move(wall),
                  recording.path.string() + ": camera " + images.name,
                  shared.threads,
                  [&](const std::string& stage) { return console.Progress(stage); });
  const std::vector<FrameImage> white = arguments.white.empty()
                                            ? images.white_images
                                            : FindImageInputs(arguments.white, "white images");
  std::optional<AttenuationComparison> comparison;
  if (!white.empty()) {
    console.Progress("white images");
    const Attenuation of_white =
        AttenuationOfWhite(white, options.response, camera.image_size, shared.threads);
    comparison = CompareAttenuations({estimate.attenuation, estimate.sigma}, of_white);
    output.Write("vignetting_compare.csv", ComparisonCsv(*comparison));
  }
  const std::vector<std::string> findings =
      FindingsOf(estimate, exposures_known ? frames : std::vector<std::string>());
  for (const std::string& finding : findings) console.Warning(finding);
  output.Write(fmt::format("vignetting_{}.tiff", images.name),
               EncodeImage(".tiff", estimate.attenuation));
  output.Write(fmt::format("vignetting_sigma_{}.tiff", images.name),
               EncodeImage(".tiff", estimate.sigma));
  output.Write("vignette.png", VignettePng(estimate.attenuation));
  output.Write("wall.png", WallPng(estimate));
  if (exposures_known) {
    output.Write("exposures.csv", ExposuresCsv(estimate, images.name, frames, exposures));
  }
  output.Write(
      "report.html",
      VignettePage(estimate, images.name, frames, findings, comparison ? &*comparison : nullptr));
  output.Commit();
  console.Print(VignetteSummary(estimate, images.name, frames.size()));
  if (comparison) console.Print("  " + ComparisonText(*comparison, "wall", "white images"));
  console.Print(fmt::format("written to {}\n", arguments.out.string()));
}

constexpr const char* kVignetteHelp =
    "Vignetting of an ordinary camera from images of a flat wall with a marker.\n"
    "\n"
    "  plenocal vignette RECORDING --camera left --calibration calibration.yaml --target tag.yaml "
    "--response pcalib.txt -o OUT\n"
    "\n"
    "Writes vignetting_<camera>.tiff, its standard deviations, vignette.png, as DSO reads it, the "
    "wall, and a report; docs/photometry.md.";

RunCommand DeclareVignette(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<VignetteArguments>();
  app->add_option("recording", arguments->recording, "recording.yaml, or a folder")->required();
  app->add_option("--camera", arguments->camera, "camera of the recording (default: the only)")
      ->expected(1);
  app->add_option("--calibration",
                  arguments->calibration,
                  "calibration.yaml of the camera; else the one that the recording names");
  app->add_option("--target", arguments->target, "target.yaml of the marker on the wall")
      ->required();
  app->add_option("--response",
                  arguments->response,
                  "pcalib.txt; else the one that the recording names, or a linear response");
  app->add_option(
      "--white", arguments->white, "white images to compare with; else those of the recording");
  app->add_option("-o,--out", arguments->out, "folder for the results")->required();
  AddQuiet(app, shared);
  AddThreads(app, shared);
  return [arguments, shared] { RunVignette(*arguments, *shared); };
}

}  // namespace

Command VignetteCommand() { return {"vignette", kVignetteHelp, DeclareVignette}; }

}  // namespace plenocal
