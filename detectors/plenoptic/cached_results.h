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
#include "calib/camera/observation_entry.h"
#include "calib/io/cache_entry.h"
#include "calib/traits/lattice_shift.h"
#include "detectors/images/image_detections.h"
#include "detectors/plenoptic/markers/marker_measurement.h"

namespace plenocal::internal {

/// The part of a plenoptic camera's white-image results that detection needs.
struct MicroLensCalibration {
  MicroLensArray array;
  std::vector<float> attenuation;  ///< of each pixel, row by row
  std::string grid_png;            ///< content of a file
  std::vector<LeftOut> left_out;   ///< white images
  std::vector<std::string> warnings;
};

/// The markers of one raw image.
struct RawDetections {
  RawMeasurements markers;
  std::vector<std::string> left_out;  ///< reasons
  std::string failure;                ///< the reason why there are no markers
  LatticeShift lattice;
};

/// Pictures of one raw image for the user: the ending of each name and the content of the file.
using Pictures = std::vector<std::pair<std::string, std::string>>;

template <MaybeConst<MarkerMeasurement> T>
auto EntryMembers(T& measured) {
  return std::tie(measured.observation,
                  measured.inverse_depth,
                  measured.vignetting_sensitivity,
                  measured.depth_sensitivity,
                  measured.gradient_sensitivity,
                  measured.lens_type,
                  measured.blur,
                  measured.blur_sigma);
}

template <MaybeConst<RawDetections> T>
auto EntryMembers(T& found) {
  return std::tie(found.markers,
                  found.left_out,
                  found.failure,
                  found.lattice.value,
                  found.lattice.sigma,
                  found.lattice.corner);
}

template <MaybeConst<MicroLensCalibration> T>
auto EntryMembers(T& camera) {
  return std::tie(
      camera.array, camera.attenuation, camera.grid_png, camera.left_out, camera.warnings);
}

/// Nothing for bytes that are no complete calibration.
std::optional<MicroLensCalibration> UnpackMicroLenses(const std::string& bytes);

}  // namespace plenocal::internal

namespace plenocal {

template <MaybeConst<MicroLens> T>
auto EntryMembers(T& lens) {
  return std::tie(lens.row, lens.column, lens.centre, lens.type, lens.usable);
}

template <MaybeConst<LatticeErrors> T>
auto EntryMembers(T& errors) {
  return std::tie(errors.image_size, errors.covariance);
}

template <MaybeConst<MicroLensArray> T>
auto EntryMembers(T& array) {
  return std::tie(
      array.image_size, array.types, array.e_column, array.e_row, array.lenses, array.errors);
}

template <MaybeConst<LeftOut> T>
auto EntryMembers(T& item) {
  return std::tie(item.where, item.reason);
}

template <MaybeConst<SampleView> T>
auto EntryMembers(T& sample) {
  return std::tie(sample.picture, sample.depth);
}

}  // namespace plenocal
