// SPDX-License-Identifier: Apache-2.0
#include "apps/report/attenuation_map.h"

#include <algorithm>
#include <opencv2/core.hpp>

#include "detectors/images/image.h"
#include "engine/json/calibration_json.h"

namespace plenocal {
namespace {

using Json = nlohmann::json;

// Of a row or column, with at most `kMost` points: means of neighbours.
Json Section(const cv::Mat& line) {
  constexpr int kMost = 2000;
  const int count = static_cast<int>(line.total());
  const int step = (count + kMost - 1) / kMost;
  Json values = Json::array();
  for (int i = 0; i < count; i += step) {
    const int end = std::min(count, i + step);
    double sum = 0;
    for (int k = i; k < end; ++k) sum += line.at<float>(k);
    values.push_back(Short(sum / (end - i), 3));
  }
  return {{"step", step}, {"values", values}};
}

}  // namespace

Json VignettingJson(const std::string& tiff, const std::string& name, double pitch) {
  const cv::Mat image = DecodeFloat({tiff.begin(), tiff.end()}, name);
  // Blocks larger than micro images avoid a moire.
  constexpr double kCells = 96, kBlock = 1.25;
  const int longer = std::max(image.cols, image.rows);
  const double cells = pitch > 0 ? std::min(kCells, longer / (kBlock * pitch)) : kCells;
  const double scale = std::min(1.0, (static_cast<int>(cells) + 1.0) / longer);
  const int columns = std::max(1, cvRound(scale * image.cols));
  const int rows = std::max(1, cvRound(scale * image.rows));
  Json highest = Json::array();
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      double value = 0;
      cv::minMaxLoc(
          image(cv::Range(row * image.rows / rows, (row + 1) * image.rows / rows),
                cv::Range(column * image.cols / columns, (column + 1) * image.cols / columns)),
          nullptr,
          &value);
      highest.push_back(Short(value, 3));
    }
  }
  const cv::Mat middle = image.row(image.rows / 2);
  Json json = {{"columns", columns},
               {"rows", rows},
               {"values", highest},
               {"row", Section(middle)},
               {"column", Section(image.col(image.cols / 2))}};
  if (pitch > 0) {
    // Few enough micro images that their profiles are visible.
    constexpr double kShown = 8;
    const auto first =
        static_cast<int>(std::max(0.0, static_cast<double>(image.cols) / 2 - kShown / 2 * pitch));
    const int last = std::min(image.cols, first + static_cast<int>(kShown * pitch));
    Json detail = Json::array();
    for (int x = first; x < last; ++x) detail.push_back(Short(middle.at<float>(x), 3));
    json["detail"] = {{"first", first}, {"values", detail}};
  }
  return json;
}

}  // namespace plenocal
