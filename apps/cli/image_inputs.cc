// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/image_inputs.h"

#include <fmt/format.h>

#include <charconv>
#include <filesystem>

#include "apps/cli/options.h"
#include "calib/base/error.h"
#include "engine/recording/stores/image_lister.h"

namespace plenocal {

std::vector<FrameImage> FindImageInputs(const std::vector<std::string>& inputs,
                                        const std::string& what) {
  std::vector<FrameImage> images;
  for (const std::string& input : inputs) {
    if (!std::filesystem::exists(input) && input.find('*') == std::string::npos &&
        SplitStorePattern(input).file.empty()) {
      throw Error(ErrorKind::kInput, fmt::format("{}: no such file; check the path", input));
    }
    const std::vector<FrameImage> found = ListImages({input}, what);
    images.insert(images.end(), found.begin(), found.end());
  }
  return images;
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

PlenopticSource FindPlenopticSource(const PlenopticInputs& inputs) {
  PlenopticSource source{.white_images = {},
                         .grid = inputs.grid,
                         .vignetting = inputs.vignetting,
                         .bayer = inputs.bayer};
  if (inputs.white.empty()) {
    if (!inputs.grid.empty()) return source;
    throw Error(ErrorKind::kInput,
                "the micro-image centres are missing; give white images with --white, or --grid "
                "micro_lenses.csv with --vignetting vignetting.tiff");
  }
  if (!inputs.vignetting.empty()) {
    throw Error(
        ErrorKind::kInput,
        "--vignetting: the white images give the attenuation already; leave one of --white and "
        "--vignetting out");
  }
  source.white_images = FindImageInputs(inputs.white, "white images");
  return source;
}

std::optional<ImageSize> ParseImageSize(const std::string& text) {
  if (text.empty()) return std::nullopt;
  ImageSize size{};
  const char* const end = text.data() + text.size();
  const auto width = std::from_chars(text.data(), end, size[0]);
  if (width.ec == std::errc() && width.ptr != end && *width.ptr == 'x') {
    const auto height = std::from_chars(width.ptr + 1, end, size[1]);
    if (height.ec == std::errc() && height.ptr == end && size[0] > 0 && size[1] > 0) return size;
  }
  throw Error(ErrorKind::kInput,
              fmt::format("--size: expected WIDTHxHEIGHT such as 640x480, found '{}'", text));
}

}  // namespace plenocal
