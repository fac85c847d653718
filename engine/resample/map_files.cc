// SPDX-License-Identifier: Apache-2.0
#include "engine/resample/map_files.h"

#include <opencv2/core.hpp>

#include "detectors/images/image.h"
#include "engine/resample/remap.h"

namespace plenocal {

std::map<std::string, std::string> MapFiles(const PixelMap& map,
                                            const std::vector<double>& pinhole,
                                            const std::string& format) {
  const auto plane = [&](const std::vector<float>& values) {
    return cv::Mat(values, false).reshape(1, map.size[1]);
  };
  const cv::Mat x = plane(map.x), y = plane(map.y);
  if (format.empty()) {
    return {{"map_x.tiff", EncodeImage(".tiff", x)},
            {"map_y.tiff", EncodeImage(".tiff", y)},
            {"mask.png", EncodeImage(".png", Remap(map, kInterpolations[0]).Mask())}};
  }
  cv::FileStorage storage("." + format, cv::FileStorage::WRITE | cv::FileStorage::MEMORY);
  const cv::Matx33d K(pinhole[0], 0, pinhole[2], 0, pinhole[1], pinhole[3], 0, 0, 1);
  storage << "image_width" << map.size[0] << "image_height" << map.size[1] << "source_width"
          << map.source_size[0] << "source_height" << map.source_size[1] << "camera_matrix"
          << cv::Mat(K) << "map_x" << x << "map_y" << y;
  return {{"", storage.releaseAndGetString()}};
}

std::string VignettePng(const cv::Mat& attenuation) {
  double largest = 0;
  cv::minMaxLoc(attenuation, nullptr, &largest);
  cv::Mat image;
  attenuation.convertTo(image, CV_16U, 65535 / largest);
  return EncodeImage(".png", image);
}

std::string VignettePng(const std::filesystem::path& attenuation) {
  return VignettePng(ReadAttenuation(attenuation));
}

}  // namespace plenocal
