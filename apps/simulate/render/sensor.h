// SPDX-License-Identifier: Apache-2.0
//
// The sensor of a simulated camera: from light to grey values.
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "apps/simulate/spec/random.h"
#include "apps/simulate/spec/simulation_spec.h"

namespace plenocal::simulate {

/// Sample positions of a pixel, px from its centre, that have equal parts of its light: along each
/// axis `count` quantiles of the point-spread function, the pixel's area convolved with a Gaussian
/// of sigma `blur`.
std::vector<float> PixelQuantiles(int count, double blur);

/// An image file's pixels (CV_8U or CV_16U) from the light that reaches each (CV_32F, 1: white
/// paper without vignetting): colour filters, exposure, shot and read noise, quantisation.
cv::Mat Expose(const cv::Mat& light, const SensorSpec& sensor, Random* random);

}  // namespace plenocal::simulate
