// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/image_answer.h"

#include <algorithm>
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

}  // namespace plenocal::workbench
