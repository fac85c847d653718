// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>

#include "apps/commands.h"
#include "apps/image_inputs.h"
#include "apps/image_module.h"
#include "calib/error.h"
#include "calib/output_folder.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

PlenopticSource CameraSource(const FocusCommand& command) {
  PlenopticSource source{.white_images = {},
                         .grid = command.grid,
                         .vignetting = command.vignetting,
                         .bayer = command.bayer};
  if (!command.white.empty()) {
    source.white_images = FindImageInputs(command.white, "white images");
    if (!command.vignetting.empty()) {
      throw Error(
          ErrorKind::kInput,
          "--vignetting: the white images give the attenuation already; leave one of --white and "
          "--vignetting out");
    }
  } else if (command.grid.empty()) {
    throw Error(ErrorKind::kInput,
                "focus: the micro-image centres are missing; give white images with --white, or "
                "--grid micro_lenses.csv with --vignetting vignetting.tiff");
  }
  return source;
}

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

void RefuseToReplaceRaw(const std::vector<FrameImage>& images, const fs::path& folder) {
  for (const char* name : {"focused.png", "virtual_depth.png", "virtual_depth.tiff"}) {
    for (const FrameImage& image : images) {
      std::error_code error;
      if (!fs::equivalent(image.path, folder / name, error)) continue;
      throw Error(
          ErrorKind::kInput,
          fmt::format("{}: the results would replace this input; give another folder with -o",
                      image.path.string()));
    }
  }
}

}  // namespace

void RunFocus(const FocusCommand& command, const ConsoleOptions& options) {
  FocusRequest request;
  request.raw_images = FindImageInputs(command.raw, "raw images");
  request.camera = CameraSource(command);
  request.scale = command.scale;
  request.threads = options.threads;
  std::optional<Target> target;
  if (!command.markers.empty()) target = ReadTarget(command.markers);
  request.target = target ? &*target : nullptr;

  const bool many = request.raw_images.size() > 1;
  const auto folder = [&](const std::string& frame) {
    return many ? command.out / frame : command.out;
  };
  CheckNames(request.raw_images);
  for (const FrameImage& image : request.raw_images) {
    RefuseToReplaceRaw(request.raw_images, folder(image.frame));
  }
  // Made before the work starts, so that a folder that cannot be written shows at once.
  OutputFolder out(command.out);
  Console console(options.quiet);
  request.message = [&](const std::string& line) { console.Message(line); };
  request.progress = [&](size_t done) {
    console.Progress("focus: images", done, request.raw_images.size());
    return !Interrupted();
  };
  request.result =
      [&](const std::string& frame, const FrameFiles& files, const std::string& summary) {
        std::optional<OutputFolder> own;
        if (many) own.emplace(folder(frame));
        OutputFolder& to = many ? *own : out;
        for (const auto& [name, content] : files) to.Write(name, content);
        to.Commit();
        console.Message(fmt::format("{}: {}", frame, summary));
      };
  FocusImagesByModule(request);
  fmt::print("written to {}\n", command.out.string());
}

}  // namespace plenocal
