// SPDX-License-Identifier: Apache-2.0
//
// Totally focused images and virtual depth of raw plenoptic images.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "calib/base/run.h"
#include "engine/recording/plenoptic_inputs.h"

namespace plenocal {

struct FocusFilesRequest {
  std::vector<std::string> raw;  ///< folders, globs and files
  PlenopticInputs camera;
  std::filesystem::path markers;  ///< target.yaml whose markers' depth is flattened; empty: none
  double scale = 2;               ///< raw pixels per pixel of the results
  std::filesystem::path out;      ///< folder for the results; of several images of their folders
};

/// Writes the results of each image as soon as it is focused. Throws `Error` as `FocusImages`, and
/// `Stopped`.
void FocusImages(const FocusFilesRequest& request, const Run& run);

}  // namespace plenocal
