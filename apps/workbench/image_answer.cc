// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/image_answer.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "apps/workbench/project/beneath.h"
#include "calib/io/input_file.h"
#include "detectors/images/image.h"
#include "detectors/images/pictures.h"

namespace plenocal::workbench {

Answer ImageAnswer(const std::filesystem::path& root, const FrameImage& image, int width) {
  constexpr auto kMostBytes = static_cast<size_t>(InputLimit::kImage);
  cv::Mat gray = image.store ? ReadRawGray(image)
                             : DecodeRawGray(ReadBeneath(root, image.path, kMostBytes), image.path);
  if (gray.depth() != CV_8U) {
    double highest = 0;
    cv::minMaxLoc(gray, nullptr, &highest);
    gray.convertTo(gray, CV_8U, 255 / std::max(highest, 1.0));
  }
  if (width > 0) gray = Reduced(gray, static_cast<double>(width) / gray.cols);
  return {.type = "image/jpeg", .body = EncodeImage(".jpg", gray)};
}

nlohmann::json DepthJson(const std::filesystem::path& root, const std::filesystem::path& file) {
  constexpr size_t kMostBytes = size_t{1} << 30;
  constexpr int kMostDepths = 512;  // columns and rows: what a screen can show
  const cv::Mat depth = DecodeFloat(ReadBeneath(root, file, kMostBytes), file);
  const int step = std::max(1, (std::max(depth.cols, depth.rows) - 1) / kMostDepths + 1);
  nlohmann::json depths = nlohmann::json::array();
  for (int y = 0; y < depth.rows; y += step) {
    for (int x = 0; x < depth.cols; x += step) {
      // Four decimals, as far as depths are measured; what is not finite becomes null.
      depths.push_back(std::round(1e4 * depth.at<float>(y, x)) / 1e4);
    }
  }
  return {{"size", {depth.cols, depth.rows}},
          {"step", step},
          {"columns", (depth.cols + step - 1) / step},
          {"rows", (depth.rows + step - 1) / step},
          {"depth", depths}};
}

}  // namespace plenocal::workbench
