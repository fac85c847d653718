// SPDX-License-Identifier: Apache-2.0
//
// How much of the light a camera loses at each pixel, from its mean white image: lens fall-off,
// stops, dust, and for a plenoptic camera the micro images themselves. CV_32F, in (0, 1]; image /
// attenuation is what an even camera would see.
#pragma once

#include <opencv2/core/mat.hpp>

#include "detectors/micro_lens_grid.h"

namespace plenocal {

/// An image (CV_32F) smoothed so far that only shading across the whole image remains.
cv::Mat LargeScaleMean(const cv::Mat& image);

/// For an ordinary camera: the white image smoothed with a Gaussian, over its maximum. `bayer`:
/// each of the four planes by itself, so that the result applies to raw mosaics.
cv::Mat SmoothAttenuation(const cv::Mat& white, bool bayer);

/// Throws `Error` of kind kJob when the white image of an ordinary camera is no even field: optics
/// only shade it smoothly, a scene has edges.
void CheckEvenField(const cv::Mat& white);

/// For a plenoptic camera, unsmoothed: the white image over the highest value of its smooth
/// envelope. `grid`: found in `white`, for `bayer` in its levelled planes.
cv::Mat MicroLensAttenuation(const cv::Mat& white, const MicroLensGrid& grid, bool bayer);

/// The four planes of a raw Bayer mosaic divided by their own large-scale means and brought to that
/// of the mosaic, so that the colours of the filters and of the light do not show. (Never
/// demosaiced: that would mix micro images.)
cv::Mat LevelBayerPlanes(const cv::Mat& mosaic);

/// How much brighter the brightest of the four planes of a 2 x 2 raster is than the darkest,
/// relative to the mean; 0 where chance explains it. The pixels of a grey camera are all alike,
/// those of a raw mosaic are not.
double PlaneDifference(const cv::Mat& white);

}  // namespace plenocal
