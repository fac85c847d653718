// SPDX-License-Identifier: Apache-2.0
//
// Inputs for the micro lenses of raw plenoptic images where no session states them.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera/bayer.h"
#include "detectors/plenoptic/plenoptic_source.h"

namespace plenocal {

struct PlenopticInputs {
  std::vector<std::string> white;    ///< white images: folders, globs and files
  std::filesystem::path grid;        ///< micro_lenses_<camera>.csv or RayCalibData XML; empty: none
  std::filesystem::path vignetting;  ///< attenuation TIFF; empty: none
  std::optional<BayerOrder> bayer;   ///< of raw mosaics
};

/// The source of micro lenses and attenuation. Throws `Error` of kind kInput when there is none, or
/// both white images and an attenuation are given.
PlenopticSource FindPlenopticSource(const PlenopticInputs& inputs);

}  // namespace plenocal
