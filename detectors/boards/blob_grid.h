// SPDX-License-Identifier: Apache-2.0
//
// Search for a grid of circles of any size.
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>
#include <optional>
#include <vector>

namespace plenocal::internal {

/// Dark or bright blobs of at least 12 px (a circle of 4 px across) and at most `most_area` px.
std::vector<cv::KeyPoint> FindBlobs(const cv::Mat& gray, bool bright, float most_area);

/// A grid of circles as an image shows it.
struct BlobGrid {
  int columns = 0, rows = 0;  ///< as `CirclesLayout` counts them; the larger first if symmetric
  bool asymmetric = false;
};

/// The largest regular grid of dark or bright blobs in an image, of any size; nothing where there
/// is none of three by three or more. `gray`: CV_8UC1; takes a second for a million pixels.
std::optional<BlobGrid> FindBlobGrid(const cv::Mat& gray);

}  // namespace plenocal::internal
