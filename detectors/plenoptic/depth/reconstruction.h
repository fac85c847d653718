// SPDX-License-Identifier: Apache-2.0
//
// From one raw image of a plenoptic camera to its virtual depth and its totally focused image.
#pragma once

#include <functional>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera/bayer.h"
#include "calib/camera/micro_lens_array.h"
#include "calib/traits/lattice_shift.h"
#include "detectors/plenoptic/depth/depth_planes.h"
#include "detectors/plenoptic/depth/lens_patches.h"
#include "detectors/plenoptic/depth/virtual_depth.h"

namespace plenocal {

/// A plenoptic camera before its calibration, from white images or files.
struct PlenopticCamera {
  MicroLensArray array;
  cv::Mat attenuation;                   ///< CV_32F in (0, 1], of array.image_size
  std::optional<BayerOrder> bayer = {};  ///< of raw mosaics
};

struct ReconstructionOptions {
  /// Raw px per pixel of the results. A point is seen by several micro images only if v >= 2; one
  /// of their pixels then covers at least two of the virtual image.
  double scale = 2;
  bool colour = false;  ///< also make the image in colour, if the raw image has colours
  int threads = 0;      ///< 0: all cores
  /// When set: finds the flat parts of a target in the focused image. Their depth is replaced by
  /// planes, and the image is synthesised again.
  std::function<std::vector<internal::FlatPart>(const cv::Mat& focused)> find_flat_parts;
  /// Error that the depths of a flat part share, part of them, in its sigma; 0 where sigma only
  /// weighs pixels against each other.
  double common_error = 0;
};

struct Reconstruction {
  /// Totally focused image: CV_32F, grey values as in the raw image; pixel (i, j) is at raw px
  /// scale * (i, j).
  cv::Mat image;
  cv::Mat colour;  ///< likewise, CV_32FC3 (BGR), when requested and there are colours; else empty
  VirtualDepth depth;
  bool keplerian = false;
  size_t flat_parts = 0;
  internal::LensPatches patches;  ///< source of `image`; released when there is `colour`
  internal::SensorNoise noise;
  LatticeShift lattice;  ///< of its micro images
};

/// The micro images in grey of a raw image as for `Reconstruct`.
internal::LensPatches GreyPatches(const cv::Mat& raw, const PlenopticCamera& camera, int threads);

/// `raw`: CV_8U or CV_16U, grey (mosaic) or BGR; moved in, so that its memory is freed early.
/// Throws `Error` of kind kInput for an image of another size, of kind kJob for one that does not
/// belong to the grid or has no texture; the message does not name the image.
Reconstruction Reconstruct(cv::Mat raw,
                           const PlenopticCamera& camera,
                           const ReconstructionOptions& options);

}  // namespace plenocal
