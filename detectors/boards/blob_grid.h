// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>

namespace plenocal::internal {

/// A grid of circles as an image shows it.
struct BlobGrid {
  int columns = 0, rows = 0;  ///< as `CirclesLayout` counts them; the larger first if symmetric
  bool asymmetric = false;
};

/// The largest regular grid of dark or bright blobs in an image, of any size; nothing where there
/// is none of three by three or more. `gray`: CV_8UC1; takes a second for a million pixels.
std::optional<BlobGrid> FindBlobGrid(const cv::Mat& gray);

}  // namespace plenocal::internal
