// SPDX-License-Identifier: Apache-2.0
//
// From one raw image of a plenoptic camera to its virtual depth and its totally focused image.
#pragma once

#include <functional>
#include <opencv2/core/mat.hpp>
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
  bool bayer = false;   ///< raw images are mosaics
};

struct FocusOptions {
  /// Raw px a pixel of the results. A point is seen by several micro images only if v >= 2, and
  /// then one of their pixels covers at least two of the virtual image.
  double scale = 2;
  int threads = 0;  ///< 0: all cores
  /// When set: finds the flat parts of a target in the focused image; their depth is replaced by
  /// planes and the image made again.
  std::function<std::vector<internal::FlatPart>(const cv::Mat& focused)> find_flat_parts;
};

struct FocusedView {
  cv::Mat
      image;  ///< CV_32F, grey values as in the raw image; pixel (i, j) is at raw px scale * (i, j)
  VirtualDepth depth;
  bool keplerian = false;
  size_t flat_parts = 0;
  internal::LensPatches patches;  ///< what it was made from
  internal::SensorNoise noise;
};

/// A raw image as one channel of CV_32F; a mosaic stays one.
cv::Mat GreyOf(const cv::Mat& raw);

/// `raw`: CV_8U or CV_16U, grey (mosaic) or BGR; moved in, its memory is free early. Throws `Error`
/// of kind kInput for an image of another size, of kind kJob for one that does not belong to the
/// grid or has no texture; the message does not name the image.
FocusedView Focus(cv::Mat raw, const PlenopticCamera& camera, const FocusOptions& options);

}  // namespace plenocal
