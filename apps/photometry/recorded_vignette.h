// SPDX-License-Identifier: Apache-2.0
//
// From a recording of a wall to the vignetting of a camera.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "apps/photometry/attenuation_compare.h"
#include "apps/photometry/vignette_fit.h"
#include "calib/base/run.h"

namespace plenocal {

struct VignetteRequest {
  std::filesystem::path recording;
  std::string camera;                 ///< empty: the only one
  std::filesystem::path calibration;  ///< empty: that of the recording
  std::filesystem::path response;     ///< pcalib.txt; empty: that of the recording, or linear
  std::filesystem::path target;       ///< of the marker on the wall
  std::vector<std::string> white;     ///< images to compare with; empty: those of the recording
  std::filesystem::path out;          ///< folder for the results; empty: none is written
};

struct RecordedVignette {
  std::string camera;
  std::vector<std::string> frames = {};  ///< used
  VignetteEstimate estimate = {};
  std::optional<AttenuationComparison> with_white = {};  ///< where there are white images
};

/// Throws `Error`: of kind kInput for a plenoptic camera; and `Stopped`.
RecordedVignette MeasureVignette(const VignetteRequest& request, const Run& run);

}  // namespace plenocal
