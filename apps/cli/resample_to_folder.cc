// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/resample_to_folder.h"

#include <fmt/format.h>

#include <map>
#include <mutex>

#include "calib/base/error.h"
#include "engine/resample/resample_images.h"

namespace plenocal {

namespace fs = std::filesystem;

void CheckImageNames(const std::vector<FrameImage>& images) {
  std::map<std::string, fs::path> seen;
  for (const FrameImage& image : images) {
    const auto [first, is_new] = seen.emplace(image.frame, image.path);
    if (!is_new) {
      throw Error(ErrorKind::kInput,
                  fmt::format("{} and {}: both results would be named '{}.png'; run them with "
                              "different -o",
                              first->second.string(),
                              image.path.string(),
                              image.frame));
    }
  }
}

size_t ResampleToFolder(const std::vector<FrameImage>& images,
                        const FolderResampling& resampling,
                        const ConsoleOptions& options,
                        OutputFolder* out) {
  const CalibratedCamera& camera = resampling.camera;
  const ResampleArguments& arguments = resampling.arguments;
  Console console(options);
  ResampleRequest request;
  request.images = images;
  request.map = &resampling.map;
  if (!arguments.keep_vignetting && !camera.vignetting.empty()) {
    request.vignetting = resampling.calibration.path.parent_path() / camera.vignetting;
  }
  request.response = ResponseOf(arguments, camera.name);
  request.bayer = arguments.bayer;
  request.interpolation = arguments.interpolation;
  request.threads = options.threads;
  request.message = [&](const std::string& line) { console.Message(line); };
  request.progress = [&](size_t done) {
    return console.Progress(camera.name + ": images", done, images.size());
  };
  std::mutex keeping;
  request.result = [&](const std::string& frame, const std::string& png) {
    out->Write(resampling.prefix + frame + ".png", png);
    if (resampling.keep == nullptr) return;
    const std::lock_guard lock(keeping);
    (*resampling.keep)[frame] = png;
  };
  return ResampleImages(request);
}

}  // namespace plenocal
