// SPDX-License-Identifier: Apache-2.0
//
// read_images IMAGE...: reads the images as grey values by OpenCV. Prints the CPU seconds of that.
// read_images --jpeg IMAGE...: writes each beside it as a colour JPEG file of quality 95.
#include <fmt/core.h>

#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <string_view>

#include "bench/speed/usage_seconds.h"

int main(int argc, char** argv) {
  const bool converts = argc > 1 && std::string_view(argv[1]) == "--jpeg";
  const double start = plenocal::bench::CpuSeconds();
  for (int i = converts ? 2 : 1; i < argc; ++i) {
    if (converts) {
      const cv::Mat image = cv::imread(argv[i], cv::IMREAD_COLOR);
      cv::imwrite(std::filesystem::path(argv[i]).replace_extension(".jpg"), image);
    } else if (cv::imread(argv[i], cv::IMREAD_ANYDEPTH).empty()) {
      return 1;
    }
  }
  fmt::print("{:.6f}\n", plenocal::bench::CpuSeconds() - start);
  return 0;
}
