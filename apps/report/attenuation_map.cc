// SPDX-License-Identifier: Apache-2.0
#include "apps/report/attenuation_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "calib/error.h"

namespace plenocal {

AttenuationMap ReadAttenuationMap(const std::string& tiff, const std::string& name, int longer) {
  cv::Mat image;
  try {
    const std::vector<unsigned char> bytes(tiff.begin(), tiff.end());
    image = cv::imdecode(bytes, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception&) {
    image.release();
  }
  if (image.empty() || image.type() != CV_32FC1) {
    throw Error(ErrorKind::kInput, fmt::format("{}: is no 32-bit float TIFF of one channel", name));
  }
  const double scale =
      std::min(1.0, static_cast<double>(longer) / std::max(image.cols, image.rows));
  cv::Mat small;
  cv::resize(image, small, {}, scale, scale, cv::INTER_AREA);
  AttenuationMap map;
  map.columns = small.cols;
  map.rows = small.rows;
  for (int y = 0; y < small.rows; ++y) {
    map.values.insert(map.values.end(), small.ptr<float>(y), small.ptr<float>(y) + small.cols);
  }
  const cv::Mat row = image.row(image.rows / 2), column = image.col(image.cols / 2).clone();
  map.middle_row.assign(row.ptr<float>(), row.ptr<float>() + row.cols);
  map.middle_column.assign(column.ptr<float>(), column.ptr<float>() + column.rows);
  return map;
}

}  // namespace plenocal
