// SPDX-License-Identifier: Apache-2.0
//
// Pictures of detections for viewing, and images made smaller.
#pragma once

#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "calib/camera/observation.h"

namespace plenocal {

/// The image reduced by `scale`, each pixel a mean; one of one row keeps it. The image itself where
/// `scale` is not below 1.
cv::Mat Reduced(const cv::Mat& image, double scale);

namespace internal {

/// A colour picture (8 bits) of an image (CV_8U) with a cross and the number at each marker.
cv::Mat MarkerPicture(const cv::Mat& gray, const std::vector<Observation>& markers);

/// An image (CV_8U) with its markers drawn, of at most 1000 pixels a side, as the content of a JPEG
/// file: what report.html shows.
std::string SamplePicture(const cv::Mat& gray, std::vector<Observation> markers);

/// Factor that brings an image to the size of a sample picture; at most 1.
double SampleScale(const cv::Mat& image);

/// A sample picture as the content of a JPEG file.
std::string EncodeSample(const cv::Mat& picture);

}  // namespace internal
}  // namespace plenocal
