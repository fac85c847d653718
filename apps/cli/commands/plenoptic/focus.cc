// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <memory>
#include <optional>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "calib/base/error.h"
#include "calib/io/output_folder.h"
#include "detectors/plenoptic/focus_images.h"
#include "engine/recording/stores/image_lister.h"

namespace plenocal {
namespace {

/// Raw plenoptic images and the source of the micro-image centres.
struct FocusArguments {
  std::vector<std::string> raw;  ///< folders, globs and files
  PlenopticInputs camera;
  std::filesystem::path markers;  ///< target.yaml; empty: none
  double scale = 2;               ///< raw pixels per pixel of the results
  std::filesystem::path out;
};

namespace fs = std::filesystem;

/// Each frame has a folder of its own, so names must differ.
void CheckNames(const std::vector<FrameImage>& images) {
  std::map<std::string, fs::path> seen;
  for (const FrameImage& image : images) {
    const auto [first, is_new] = seen.emplace(image.frame, image.path);
    if (is_new) continue;
    throw Error(
        ErrorKind::kInput,
        fmt::format("{} and {}: both results would be named '{}'; run them with different -o",
                    first->second.string(),
                    image.path.string(),
                    image.frame));
  }
}

void RunFocus(const FocusArguments& arguments, const ConsoleOptions& shared) {
  FocusRequest request;
  request.raw_images = FindImageInputs(arguments.raw, "raw images");
  request.camera = FindPlenopticSource(arguments.camera);
  request.scale = arguments.scale;
  request.threads = shared.threads;
  std::optional<Target> target;
  if (!arguments.markers.empty()) target = ReadTarget(arguments.markers);
  request.target = target ? &*target : nullptr;

  const bool many = request.raw_images.size() > 1;
  const auto folder = [&](const std::string& frame) {
    return many ? arguments.out / frame : arguments.out;
  };
  CheckNames(request.raw_images);
  OutputFolder out(arguments.out);
  Console console(shared);
  request.message = [&](const std::string& line) { console.Message(line); };
  std::string place;  // "2 of 7"
  request.progress = [&](size_t done) {
    place = fmt::format("{} of {}", done + 1, request.raw_images.size());
    return console.Progress(
        fmt::format("focus: image {}, {}", place, request.raw_images[done].frame));
  };
  request.result =
      [&](const std::string& frame, const FrameFiles& files, const std::string& summary) {
        std::optional<OutputFolder> own;
        if (many) own.emplace(folder(frame));
        OutputFolder& to = many ? *own : out;
        for (const auto& [name, content] : files) to.Write(name, content);
        to.Commit();
        console.Message(fmt::format("image {}, {}: {}", place, frame, summary));
      };
  FocusImages(request);
  console.Print(fmt::format("written to {}\n", arguments.out.string()));
}

constexpr const char* kFocusHelp =
    "From raw images of a plenoptic camera to totally focused images and virtual depth.\n"
    "\n"
    "  plenocal focus RAW --white WHITE... -o OUT\n"
    "\n"
    "writes OUT/focused.png, virtual_depth.tiff, virtual_depth_sigma.tiff, virtual_depth.png, virtual_depth_16bit.png (RxLive) and focused.yaml; of several raw images OUT/<frame>/...";

RunCommand DeclareFocus(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<FocusArguments>();
  app->add_option("raw", arguments->raw, "raw images: files, globs or folders")->required();
  app->add_option("-o,--out", arguments->out, "folder for the results")->required();
  AddPlenopticInputs(app, &arguments->camera);
  app->add_option("--markers",
                  arguments->markers,
                  "target.yaml: fit a plane to the depth of each marker found and focus again");
  app->add_option("--scale", arguments->scale, "raw pixels per pixel of the results")
      ->check(CLI::Range(0.5, 16.0))
      ->capture_default_str();
  AddThreads(app, shared);
  AddQuiet(app, shared);
  return [arguments, shared] { RunFocus(*arguments, *shared); };
}

}  // namespace

Command FocusCommand() { return {"focus", kFocusHelp, DeclareFocus}; }

}  // namespace plenocal
