// SPDX-License-Identifier: Apache-2.0
//
// Micro-image centres, attenuation and noise of cameras from their white images.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "calib/base/run.h"
#include "detectors/plenoptic/white/white_camera.h"

namespace plenocal {

/// White images: those of a session's cameras, or, with `model`, the files that `inputs` lists.
struct WhiteRequest {
  std::vector<std::string> inputs;  ///< session.yaml; or folders, globs and files
  std::string model;                ///< camera model; empty: `inputs` is a session
  std::string camera;               ///< name for the results; empty: that of the images' folder
  std::optional<BayerOrder> bayer;  ///< of raw mosaics
  std::optional<std::filesystem::path> grid;  ///< RayCalibData XML
  bool xml = false;                           ///< also write the grid as such a file
  std::filesystem::path out;                  ///< folder for the results; empty: none is written
};

struct WhiteResult {
  std::string camera;
  size_t images = 0;  ///< given
  WhiteCamera white = {};
};

/// By camera, in the session's order. Throws `Error`, and `Stopped`.
std::vector<WhiteResult> MeasureWhiteImages(const WhiteRequest& request, const Run& run);

}  // namespace plenocal
