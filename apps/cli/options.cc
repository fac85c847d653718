// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/options.h"

#include <fcntl.h>

#include <charconv>

#include "calib/base/format_error.h"
#include "engine/session/open_session.h"

namespace plenocal {

void AddOut(CLI::App* app, std::filesystem::path* out, const std::string& help) {
  app->add_option("-o,--out", *out, help)->required();
}

void AddJson(CLI::App* app, bool* json) {
  app->add_flag("--json", *json, "JSON on standard output");
}

void AddSpaceFrame(CLI::App* app, SpaceFrame* frame) {
  app->add_option_function<std::string>(
         "--frame",
         [frame](const std::string& name) {
           *frame = name == "housing" ? SpaceFrame::kHousing : SpaceFrame::kRig;
         },
         "errors in the first camera's frame, or less the motion that the calibration's own points "
         "follow")
      ->check(CLI::IsMember({"rig", "housing"}))
      ->default_str("rig");
}

void AddCalibration(CLI::App* app, std::filesystem::path* calibration) {
  app->add_option("calibration", *calibration, "calibration.yaml")->required();
}

void AddRecording(CLI::App* app, std::filesystem::path* recording) {
  app->add_option("recording", *recording, "recording.yaml, or a folder")->required();
}

void AddThreads(CLI::App* app, ConsoleOptions* shared) {
  constexpr int kMostThreads = 1024;  // more is a slip of the finger
  app->add_option("--threads", shared->threads, "number of threads (default: all cores)")
      ->check(CLI::Range(1, kMostThreads));
}

void AddQuiet(CLI::App* app, ConsoleOptions* shared) {
  app->add_flag("--quiet", shared->quiet, "no messages and no progress, only errors");
}

void AddThreadsAndQuiet(CLI::App* app, ConsoleOptions* shared) {
  AddThreads(app, shared);
  AddQuiet(app, shared);
}

void AddEvents(CLI::App* app, ConsoleOptions* shared) {
  app->add_option_function<int>(
         "--events",
         [shared](int file) {
           // A copy of its own: decoders of images may write to standard error, which is led
           // elsewhere meanwhile.
           constexpr int kBehindStandard = 3;
           const int copy = fcntl(file, F_DUPFD_CLOEXEC, kBehindStandard);
           if (copy == -1) {
             throw InputError("--events {}: no open file has this number", file);
           }
           shared->events = copy;
         },
         "number of an open file that takes progress as JSON lines: for programs that run this one")
      ->check(CLI::Range(1, 1 << 20));
}

void AddBayer(CLI::App* app, std::optional<BayerOrder>* bayer, const std::string& help) {
  app->add_option_function<std::string>(
         "--bayer", [bayer](const std::string& name) { *bayer = ParseBayerOrder(name); }, help)
      ->check(CLI::IsMember(std::vector<std::string>(kBayerOrders.begin(), kBayerOrders.end())));
}

void AddImageSize(CLI::App* app, std::optional<ImageSize>* size, const std::string& help) {
  app->add_option_function<std::string>(
      "--size",
      [size](const std::string& text) {
        ImageSize found{};
        const char* const end = text.data() + text.size();
        const auto width = std::from_chars(text.data(), end, found[0]);
        if (*width.ptr == 'x') {
          const auto height = std::from_chars(width.ptr + 1, end, found[1]);
          *size = found;
          // A number that cannot be read stays 0.
          if (height.ptr == end && found[0] > 0 && found[1] > 0) return;
        }
        throw InputError("--size: expected WIDTHxHEIGHT such as 640x480, found '{}'", text);
      },
      help);
}

void AddPlenopticInputs(CLI::App* app, PlenopticInputs* inputs) {
  app->add_option("--white", inputs->white, "white images of the camera: files, globs or folders");
  app->add_option("--grid",
                  inputs->grid,
                  "instead of white images: micro_lenses_<camera>.csv or RayCalibData XML");
  app->add_option("--vignetting",
                  inputs->vignetting,
                  "with --grid: attenuation TIFF (default: the raw images are corrected already)");
  AddBayer(app, &inputs->bayer, "colours of the top-left 2 x 2 pixels of raw mosaics");
}

void AddImageArguments(CLI::App* app, ImageArguments* images) {
  app->add_option(
      "--target",
      images->target,
      "of images: chessboard:9x6:25mm (inner corners, square), aprilgrid:6x6:88mm:0.3, "
      "charuco:5x7:36mm:18mm:6X6_250, circles:10x7:25mm[:asymmetric], or a target file; "
      "without it, the target is looked for in the images");
  app->add_option("--right",
                  images->right,
                  "images of a second camera on the same rig; after those of the first");
  app->add_option("--camera", images->cameras, "NAME=GLOB: images of a camera; several are a rig")
      ->expected(1)
      ->take_all();
}

void AddInputs(CLI::App* app, ImageArguments* inputs) {
  app->add_option(
      "input",
      inputs->images,
      "session.yaml; or images of a camera: a glob in quotation marks, files or a folder");
  AddImageArguments(app, inputs);
}

std::string SessionFileOf(const ImageArguments& inputs, const char* command) {
  if (inputs.images.empty() && inputs.cameras.empty()) {
    throw InputError(
        "{}: {}",
        command,
        inputs.right.empty()
            ? "give session.yaml, or images (a glob, files or a folder) with --target"
            : "--right takes all that follows; give the first camera's images before it");
  }
  if (!NamesSession(inputs.images)) return {};
  const std::string& session = inputs.images[0];
  if (inputs.right.empty() && inputs.cameras.empty() && inputs.target.empty()) return session;
  throw InputError(
      "{}: a session has cameras and target itself; --target, --right and --camera go with images",
      session);
}

Session OpenInputs(const ImageArguments& inputs, const char* command, const Run& run) {
  const std::string session = SessionFileOf(inputs, command);
  return session.empty() ? ImageSession(inputs, {}, run).With(kAuto, kAuto) : OpenSession(session);
}

void AddResultOptions(CLI::App* app, SessionOptions* options, ConsoleOptions* shared) {
  AddOut(app, &options->out);
  AddThreadsAndQuiet(app, shared);
  AddEvents(app, shared);
  app->add_option("--exclude",
                  options->exclude,
                  "leave out what matches, beside the session's 'exclude': \"camera: left, frame: "
                  "'07'\", \"frame: '1*'\", \"markers: [17, 18]\"; may stand several times")
      ->expected(1)
      ->take_all();
  app->add_option(
      "--cache",
      options->cache,
      "folder that keeps detections for later runs, which may write elsewhere (default: OUT)");
  CLI::Option* const frames = app->add_option(
      "--frames",
      options->frames,
      "use at most so many frames: sharp, at rest, and such that they lower the projection's sigma most (default: 100 of recordings and videos with more than 200)");
  frames->check(CLI::Range(1, 1 << 30));
  app->add_flag("--all", options->all, "use all frames")->excludes(frames);
  app->add_flag(
      "--keep",
      options->keep,
      "write pictures of the stages into OUT/images/<camera>: markers drawn, of a plenoptic camera focused image, depth and micro-lens grid as well");
  app->add_flag(
      "--fresh",
      options->fresh,
      "detect again in all images (default: detections of earlier runs into OUT are reused where nothing has changed)");
}

}  // namespace plenocal
