// SPDX-License-Identifier: Apache-2.0
//
// The attenuation of an ordinary camera from white images.
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "calib/camera/observation.h"
#include "calib/files/frame_images.h"
#include "detectors/photometry/response_curve.h"

namespace plenocal {

/// An attenuation and its relative standard deviation, CV_32F, of the images' size.
struct Attenuation {
  cv::Mat values;  ///< largest value 1
  cv::Mat sigma;   ///< up to a common factor of all pixels; empty: not known
};

/// The attenuation of an ordinary camera from white images of 8 bits, as a spline; the standard
/// deviation is that of the noise, not of light that is uneven. Throws `Error` of kind kInput for
/// images that cannot be read, have another size or 16 bits, or are saturated; `size`: expected.
Attenuation MeasureAttenuation(const std::vector<FrameImage>& images,
                               const ResponseCurve& response,
                               const ImageSize& size,
                               int threads);

}  // namespace plenocal
