// SPDX-License-Identifier: Apache-2.0
//
// What a calibration is worth in millimetres, from its folder alone.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "assess/space/accuracy.h"
#include "calib/base/run.h"
#include "calib/io/output_folder.h"

namespace plenocal {

struct AccuracyRequest : AccuracyOptions {
  std::filesystem::path calibration;           ///< folder of `calibrate`, or a calibration.yaml
  std::vector<std::vector<std::string>> sets;  ///< names of cameras; empty: `CameraSets`
};

/// Micro images of each camera by the files beside calibration.yaml; none of ordinary ones.
std::vector<MicroLensVisibility> ReadVisibility(const std::filesystem::path& folder,
                                                const CalibrationRecord& calibration);

/// Throws `Error` of kind kInput as `PredictAccuracy`, and for a request that does not fit. Sets
/// that were not asked for and cannot be computed are left out with a message.
std::vector<RigAccuracy> PredictAccuracy(const AccuracyRequest& request, const Run& run);

/// accuracy.csv and accuracy.json (docs/formats.md).
OutputContents AccuracyFiles(const AccuracyRequest& request,
                             const std::vector<RigAccuracy>& accuracies);
/// Lines of all distances, limits and findings.
std::string AccuracyText(const std::vector<RigAccuracy>& accuracies);

/// The sets of a report, few cells of each. `lenses`: micro images of each camera. Empty where
/// nothing can be predicted.
std::vector<RigAccuracy> AccuracyInBrief(const CalibrationRecord& calibration,
                                         const std::vector<MicroLensVisibility>& lenses);

}  // namespace plenocal
