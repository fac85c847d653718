// SPDX-License-Identifier: Apache-2.0
//
// Attenuation: the share of the light that reaches each pixel, from the mean white image (lens
// fall-off, stops, dust). CV_32F, in (0, 1]; image / attenuation is the image of a camera without
// vignetting.
#pragma once

#include <functional>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "calib/camera/bayer.h"

namespace plenocal {

/// An image (CV_32F) smoothed so far that only shading across the whole image remains.
cv::Mat LargeScaleMean(const cv::Mat& image);

/// Attenuation of an ordinary camera: the white image smoothed with a Gaussian, over its maximum.
/// Of a mosaic each of the four planes by itself, so that the result applies to raw mosaics.
cv::Mat SmoothAttenuation(const cv::Mat& white, std::optional<BayerOrder> bayer);

/// Throws `Error` of kind kJob when the white image of an ordinary camera is no even field: optics
/// only shade it smoothly, a scene has edges.
void CheckEvenField(const cv::Mat& white);

/// Brightness difference between the brightest and the darkest of the four planes of a 2 x 2
/// raster, relative to the mean; 0 where noise explains it. It distinguishes raw mosaics from grey
/// images.
double PlaneDifference(const cv::Mat& white);

/// Whether the four planes of a 2 x 2 raster are as bright as each other, as those of a grey image:
/// not where noise would hide a difference that `PlaneDifference` shows.
bool PlanesAgree(const cv::Mat& white);

/// Brightness difference of the two green planes of a white image by a colour order, relative to
/// the mean; 0 unless it shows that the order is wrong: the other two planes are alike.
double GreenDifference(const cv::Mat& white, BayerOrder order);

namespace internal {

/// Calls change(plane) on each of the four colour planes of a mosaic and puts them back.
cv::Mat ForBayerPlanes(const cv::Mat& mosaic, const std::function<cv::Mat(const cv::Mat&)>& change);

/// An attenuation within its limits: at most 1, and not so small that its inverse is noise.
cv::Mat LimitAttenuation(const cv::Mat& attenuation);

}  // namespace internal

}  // namespace plenocal
