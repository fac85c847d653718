// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/image_answer.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "apps/workbench/project/beneath.h"
#include "calib/base/format_error.h"
#include "calib/io/input_file.h"
#include "detectors/images/image.h"
#include "detectors/images/pictures.h"
#include "engine/resample/pixel_map.h"
#include "engine/resample/rectify.h"
#include "engine/resample/remap.h"

namespace plenocal::workbench {

namespace {

// 8 bits.
cv::Mat GrayOf(const std::filesystem::path& root, const FrameImage& image) {
  constexpr auto kMostBytes = static_cast<size_t>(InputLimit::kImage);
  cv::Mat gray = image.store ? ReadRawGray(image)
                             : DecodeRawGray(ReadBeneath(root, image.path, kMostBytes), image.path);
  if (gray.depth() != CV_8U) {
    double highest = 0;
    cv::minMaxLoc(gray, nullptr, &highest);
    gray.convertTo(gray, CV_8U, 255 / std::max(highest, 1.0));
  }
  return gray;
}

Answer JpegAnswer(const cv::Mat& picture) {
  return {.type = "image/jpeg", .body = EncodeImage(".jpg", picture)};
}

// `R_camera_view` as MapPixels has it.
cv::Mat Resampled(const cv::Mat& gray,
                  const CalibratedCamera& view,
                  const CalibratedCamera& camera,
                  const Eigen::Matrix3d& R_camera_view) {
  if (gray.cols != camera.image_size[0] || gray.rows != camera.image_size[1]) {
    throw InputError("{}: the image has {} x {} px, the calibration {} x {}",
                     camera.name,
                     gray.cols,
                     gray.rows,
                     camera.image_size[0],
                     camera.image_size[1]);
  }
  return Remap(MapPixels(view, camera, R_camera_view, /*threads=*/1), "linear")(gray);
}

}  // namespace

Answer ImageAnswer(const std::filesystem::path& root, const FrameImage& image, int width) {
  cv::Mat gray = GrayOf(root, image);
  if (width > 0) gray = Reduced(gray, static_cast<double>(width) / gray.cols);
  return JpegAnswer(gray);
}

Answer UndistortedAnswer(const std::filesystem::path& root,
                         const FrameImage& image,
                         const CalibratedCamera& camera) {
  return JpegAnswer(Resampled(
      GrayOf(root, image), UndistortedView(camera, {}), camera, Eigen::Matrix3d::Identity()));
}

Answer RectifiedAnswer(const std::filesystem::path& root,
                       const std::array<FrameImage, 2>& images,
                       const std::array<const CalibratedCamera*, 2>& cameras) {
  const RectifiedPair pair = Rectify(*cameras[0], *cameras[1], {});
  std::array<cv::Mat, 2> views;
  for (size_t i = 0; i < 2; ++i) {
    views[i] = Resampled(
        GrayOf(root, images[i]), pair.views[i], *cameras[i], pair.R_view_camera[i].transpose());
  }
  cv::Mat both;
  cv::hconcat(views, both);
  return JpegAnswer(both);
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
