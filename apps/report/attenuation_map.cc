// SPDX-License-Identifier: Apache-2.0
#include "apps/report/attenuation_map.h"

#include <algorithm>
#include <opencv2/core.hpp>

#include "detectors/images/image.h"

namespace plenocal {

AttenuationMap ReadAttenuationMap(const std::string& tiff, const std::string& name, int longer) {
  const cv::Mat image = DecodeFloat({tiff.begin(), tiff.end()}, name);
  const double scale =
      std::min(1.0, static_cast<double>(longer) / std::max(image.cols, image.rows));
  AttenuationMap map;
  map.columns = std::max(1, cvRound(scale * image.cols));
  map.rows = std::max(1, cvRound(scale * image.rows));
  for (int row = 0; row < map.rows; ++row) {
    for (int column = 0; column < map.columns; ++column) {
      const cv::Mat block = image(
          cv::Range(row * image.rows / map.rows, (row + 1) * image.rows / map.rows),
          cv::Range(column * image.cols / map.columns, (column + 1) * image.cols / map.columns));
      double highest = 0;
      cv::minMaxLoc(block, nullptr, &highest);
      map.values.push_back(static_cast<float>(highest));
    }
  }
  const cv::Mat row = image.row(image.rows / 2), column = image.col(image.cols / 2).clone();
  map.middle_row.assign(row.ptr<float>(), row.ptr<float>() + row.cols);
  map.middle_column.assign(column.ptr<float>(), column.ptr<float>() + column.rows);
  return map;
}

}  // namespace plenocal
