// SPDX-License-Identifier: Apache-2.0
//
// Results of the stages of plenoptic detection, as they are kept in the detection cache
// (`DetectionCache`) between runs.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calib/camera/micro_lens_array.h"
#include "detectors/images/image_detections.h"
#include "detectors/plenoptic/markers/marker_measurement.h"

namespace plenocal::internal {

/// The part of a plenoptic camera's white-image results that detection needs.
struct MicroLensCalibration {
  MicroLensArray array;
  std::string attenuation_tiff, grid_png;  ///< contents of files
  std::vector<LeftOut> left_out;           ///< white images
};

/// The markers of one raw image.
struct RawDetections {
  RawMeasurements markers;
  std::vector<std::string> left_out;  ///< reasons
  std::string failure;                ///< the reason why there are no markers
};

/// Pictures of one raw image for the user: the ending of each name and the content of the file.
using Pictures = std::vector<std::pair<std::string, std::string>>;

// `Unpack...` returns nothing for bytes that are no complete result.
std::string Pack(const MicroLensCalibration& micro_lenses);
std::string Pack(const RawDetections& detections);
std::string Pack(const Pictures& pictures);
std::string Pack(const SampleView& sample);
std::optional<MicroLensCalibration> UnpackMicroLenses(const std::string& bytes);
std::optional<RawDetections> UnpackDetections(const std::string& bytes);
std::optional<Pictures> UnpackPictures(const std::string& bytes);
std::optional<SampleView> UnpackSample(const std::string& frame, const std::string& bytes);

}  // namespace plenocal::internal
