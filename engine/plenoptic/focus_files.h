// SPDX-License-Identifier: Apache-2.0
//
// Totally focused images and virtual depth of raw plenoptic images.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "calib/base/run.h"
#include "detectors/plenoptic/focus_images.h"
#include "engine/recording/plenoptic_inputs.h"

namespace plenocal {

struct FocusFilesRequest {
  std::vector<std::string> raw;  ///< folders, globs and files
  PlenopticInputs camera;
  std::filesystem::path markers;  ///< target.yaml whose markers' depth is flattened; empty: none
  double scale = 2;               ///< raw pixels per pixel of the results
  /// Folder for the results; of several images of their folders. Empty: none is written.
  std::filesystem::path out;
};

/// The results of one raw image.
struct FocusResult {
  std::string frame;
  FrameFiles files;     ///< only where no folder is written
  std::string summary;  ///< one line
};

/// Writes the results of each image as soon as it is focused. Throws `Error` as `FocusImages`, and
/// `Stopped`.
std::vector<FocusResult> FocusImages(const FocusFilesRequest& request, const Run& run);

}  // namespace plenocal
