// SPDX-License-Identifier: Apache-2.0
//
// Options of the commands that make images of a pinhole camera: map, undistort, rectify.
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera/bayer.h"
#include "detectors/photometry/response_curve.h"
#include "engine/resample/pinhole_view.h"

namespace plenocal {

/// The pinhole camera to make images of.
struct ViewArguments {
  std::string size;               ///< "640x480"; empty: the camera's own
  std::optional<double> fov;      ///< horizontal field of view, degrees
  std::optional<double> balance;  ///< 0: every pixel has a source, 1: all that the camera images
};

/// How images are resampled.
struct ResampleArguments {
  std::string interpolation = "linear";
  std::optional<BayerOrder> bayer;  ///< of raw mosaics
  bool keep_vignetting = false;     ///< do not remove the vignetting that the calibration has
  /// pcalib.txt of a response that is to be undone, of all cameras, or NAME=pcalib.txt of one.
  std::vector<std::string> photometric;
  bool mask = false;  ///< write mask.png: the pixels that have a source
};

/// Declares `--size`, `--fov` and `--balance`.
void AddViewOptions(CLI::App* app, ViewArguments* view);
/// Declares `--interpolation`, `--bayer`, `--keep-vignetting`, `--photometric` and `--mask`.
void AddResampleOptions(CLI::App* app, ResampleArguments* resample);

/// The response of a camera that `--photometric` names; nothing without the option. Throws `Error`
/// of kind kInput when it names others only.
std::optional<ResponseCurve> ResponseOf(const ResampleArguments& arguments,
                                        const std::string& camera);

/// Throws `Error` of kind kInput when `size` is not a size.
ViewOptions ToViewOptions(const ViewArguments& arguments);

/// One line about a pinhole camera: size, focal lengths, principal point, fields of view.
std::string ViewText(const CalibratedCamera& view);

}  // namespace plenocal
