// SPDX-License-Identifier: Apache-2.0
//
// ArUco dictionaries and pictures of their markers, of OpenCV 4.6 and of its successors.
#pragma once

#include <opencv2/aruco.hpp>

namespace plenocal::testing {

/// OpenCV 4.6 returns a pointer to a dictionary, its successors the dictionary.
inline cv::Ptr<cv::aruco::Dictionary> ArucoDictionary(int index) {
  return cv::makePtr<cv::aruco::Dictionary>(cv::aruco::getPredefinedDictionary(index));
}

/// A marker with its black border, a pixel a cell: 0 or 1.
inline cv::Mat ArucoCells(const cv::aruco::Dictionary& dictionary, int id) {
  cv::Mat cells;
  cv::copyMakeBorder(cv::aruco::Dictionary::getBitsFromByteList(
                         dictionary.bytesList.rowRange(id, id + 1), dictionary.markerSize),
                     cells,
                     1,
                     1,
                     1,
                     1,
                     cv::BORDER_CONSTANT);
  return cells;
}

}  // namespace plenocal::testing
