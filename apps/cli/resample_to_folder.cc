// SPDX-License-Identifier: Apache-2.0
#include "apps/resample.h"

#include <fmt/format.h>

#include <cmath>
#include <map>
#include <numbers>

#include "apps/image_inputs.h"
#include "apps/image_module.h"
#include "calib/error.h"

namespace plenocal {

namespace fs = std::filesystem;

ViewOptions ToViewOptions(const ViewArguments& arguments) {
  return {
      .size = ParseImageSize(arguments.size), .fov = arguments.fov, .balance = arguments.balance};
}

std::string ViewText(const CalibratedCamera& view) {
  const auto angle = [&](size_t axis) {
    const double f = view.params[axis], c = view.params[2 + axis];
    const double degrees = 180 / std::numbers::pi;
    return (std::atan((c + 0.5) / f) + std::atan((view.image_size[axis] - 0.5 - c) / f)) * degrees;
  };
  return fmt::format("{} x {} px, f {:.2f} {:.2f} px, c {:.2f} {:.2f} px, {:.1f} x {:.1f} degrees",
                     view.image_size[0],
                     view.image_size[1],
                     view.params[0],
                     view.params[1],
                     view.params[2],
                     view.params[3],
                     angle(0),
                     angle(1));
}

void CheckImageNames(const std::vector<FrameImage>& images, const fs::path& folder) {
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
  for (const FrameImage& image : images) {
    for (const auto& [frame, path] : seen) {
      std::error_code error;
      if (!fs::equivalent(image.path, folder / (frame + ".png"), error)) continue;
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: the results would replace this input; give another folder with "
                              "-o",
                              image.path.string()));
    }
  }
}

size_t ResampleInto(const std::vector<FrameImage>& images,
                    const CalibrationFile& calibration,
                    const CalibratedCamera& camera,
                    const PixelMap& map,
                    const ResampleArguments& arguments,
                    const ConsoleOptions& options,
                    const std::string& prefix,
                    OutputFolder* out) {
  Console console(options.quiet);
  ResampleRequest request;
  request.images = images;
  request.map = &map;
  if (!arguments.keep_vignetting && !camera.vignetting.empty()) {
    request.vignetting = calibration.path.parent_path() / camera.vignetting;
  }
  request.bayer = arguments.bayer;
  request.interpolation = arguments.interpolation;
  request.threads = options.threads;
  request.message = [&](const std::string& line) { console.Message(line); };
  request.progress = [&](size_t done) {
    console.Progress(camera.name + ": images", done, images.size());
    return !Interrupted();
  };
  request.result = [&](const std::string& frame, const std::string& png) {
    out->Write(prefix + frame + ".png", png);
  };
  return ResampleImagesByModule(request);
}

}  // namespace plenocal
