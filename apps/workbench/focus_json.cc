// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/focus_json.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core/mat.hpp>
#include <string>

#include "apps/workbench/project/beneath.h"
#include "calib/io/yaml.h"
#include "detectors/images/image.h"

namespace plenocal::workbench {
namespace {

using Json = nlohmann::json;
constexpr size_t kMostDescription = 64 * 1024;
constexpr size_t kMostImage = size_t{1} << 30;
// Columns and rows that the page is given: what a screen can show.
constexpr int kMostDepths = 512;

}  // namespace

Json FocusJson(const std::filesystem::path& root, const std::filesystem::path& folder) {
  const auto text = ReadBeneath(root, folder / "focused.yaml", kMostDescription);
  const YamlNode yaml =
      YamlNode::Parse(std::string(text.begin(), text.end()), (folder / "focused.yaml").string());
  const auto file = folder / "virtual_depth.tiff";
  const cv::Mat depth = DecodeFloat(ReadBeneath(root, file, kMostImage), file);
  const int step = std::max(1, (std::max(depth.cols, depth.rows) - 1) / kMostDepths + 1);
  Json depths = Json::array();
  int columns = 0, rows = 0;
  for (int y = 0; y < depth.rows; y += step) {
    ++rows;
    columns = 0;
    for (int x = 0; x < depth.cols; x += step) {
      ++columns;
      const float value = depth.at<float>(y, x);
      // Five digits, as far as depths are measured.
      depths.push_back(std::isfinite(value) ? Json(std::round(1e4 * value) / 1e4) : Json(nullptr));
    }
  }
  return {{"offset", yaml.At("offset").AsNumbers(2)},
          {"scale", yaml.At("scale").AsNumber()},
          {"size", {depth.cols, depth.rows}},
          {"step", step},
          {"columns", columns},
          {"rows", rows},
          {"depth", depths}};
}

}  // namespace plenocal::workbench
