// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera/bayer.h"
#include "calib/camera/observation.h"
#include "calib/files/frame_images.h"
#include "detectors/plenoptic/plenoptic_source.h"

namespace plenocal {

/// The images of command-line arguments: each a file, a glob or a folder with images. `what`
/// ("white images") is used in messages. Throws `Error` of kind kInput when an argument matches
/// nothing.
std::vector<FrameImage> FindImageInputs(const std::vector<std::string>& inputs,
                                        const std::string& what);

/// Options of commands that take raw plenoptic images without a session.
struct PlenopticInputs {
  std::vector<std::string> white;    ///< white images: folders, globs and files
  std::filesystem::path grid;        ///< micro_lenses_<camera>.csv or RayCalibData XML; empty: none
  std::filesystem::path vignetting;  ///< attenuation TIFF; empty: none
  std::optional<BayerOrder> bayer;   ///< of raw mosaics
};

/// Declares `--white`, `--grid`, `--vignetting` and `--bayer`.
void AddPlenopticInputs(CLI::App* app, PlenopticInputs* inputs);

/// The source of micro lenses and attenuation. Throws `Error` of kind kInput when there is none, or
/// both white images and an attenuation are given.
PlenopticSource FindPlenopticSource(const PlenopticInputs& inputs);

/// The value of `--size`, "640x480"; nothing for an empty text. Throws `Error` of kind kInput.
std::optional<ImageSize> ParseImageSize(const std::string& text);

}  // namespace plenocal
