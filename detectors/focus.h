// SPDX-License-Identifier: Apache-2.0
//
// From one raw image of a plenoptic camera to its virtual depth and its totally focused image.
#pragma once

#include <functional>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "calib/micro_lens_array.h"
#include "detectors/lens_patches.h"
#include "detectors/marker_planes.h"
#include "detectors/virtual_depth.h"

namespace plenocal {

/// What white images or files tell of a plenoptic camera.
struct PlenopticCamera {
  MicroLensArray array;
  cv::Mat attenuation;  ///< CV_32F in (0, 1], of array.image_size
  /// Colours of the top left 2 x 2 pixels of raw mosaics, row by row, such as "RGGB"; empty: raw
  /// images are none.
  std::string bayer = {};
};

struct FocusOptions {
  /// Raw px a pixel of the results. A point is seen by several micro images only if v >= 2, and
  /// then one of their pixels covers at least two of the virtual image.
  double scale = 2;
  bool colour = false;  ///< also in colour, if the raw image has colours
  int threads = 0;      ///< 0: all cores
  /// When set: finds the flat parts of a target in the focused image; their depth is replaced by
  /// planes and the image made again.
  std::function<std::vector<internal::FlatPart>(const cv::Mat& focused)> find_flat_parts;
};

struct FocusedView {
  cv::Mat
      image;  ///< CV_32F, grey values as in the raw image; pixel (i, j) is at raw px scale * (i, j)
  cv::Mat colour;  ///< CV_32FC3 (BGR), likewise, when asked for and there are colours; else empty
  VirtualDepth depth;
  bool keplerian = false;
  size_t flat_parts = 0;
  internal::LensPatches patches;  ///< what `image` was made from; not kept with colour
  internal::SensorNoise noise;
};

/// The micro images of a raw image, as `Focus` takes it, in grey.
internal::LensPatches GreyPatches(const cv::Mat& raw, const PlenopticCamera& camera, int threads);

/// `raw`: CV_8U or CV_16U, grey (mosaic) or BGR; moved in, its memory is free early. Throws `Error`
/// of kind kInput for an image of another size, of kind kJob for one that does not belong to the
/// grid or has no texture; the message does not name the image.
FocusedView Focus(cv::Mat raw, const PlenopticCamera& camera, const FocusOptions& options);

}  // namespace plenocal
