// SPDX-License-Identifier: Apache-2.0
//
// apriltag_detect IMAGE...: reads the images and finds tags with libapriltag at decimate 2, images
// in parallel over the cores. Prints wall and CPU seconds without start-up, and the number of tags.
#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>
#include <fmt/core.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <opencv2/imgcodecs.hpp>
#include <thread>
#include <vector>

#include "bench/speed/usage_seconds.h"

int main(int argc, char** argv) {
  const auto start = std::chrono::steady_clock::now();
  const double cpu_start = plenocal::bench::CpuSeconds();
  std::atomic<int> next = 1, tags = 0;
  {
    std::vector<std::jthread> threads;
    for (unsigned i = 0; i < std::max(1U, std::thread::hardware_concurrency()); ++i) {
      threads.emplace_back([&] {
        apriltag_family_t* family = tag36h11_create();
        apriltag_detector_t* detector = apriltag_detector_create();
        apriltag_detector_add_family(detector, family);
        detector->quad_decimate = 2;
        detector->nthreads = 1;
        for (int n = next++; n < argc; n = next++) {
          const cv::Mat image = cv::imread(argv[n], cv::IMREAD_GRAYSCALE);
          image_u8_t view{image.cols, image.rows, static_cast<int>(image.step), image.data};
          zarray_t* found = apriltag_detector_detect(detector, &view);
          tags += zarray_size(found);
          apriltag_detections_destroy(found);
        }
        apriltag_detector_destroy(detector);
        tag36h11_destroy(family);
      });
    }
  }
  const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - start;
  fmt::print(
      "{:.6f} {:.6f} {}\n", wall.count(), plenocal::bench::CpuSeconds() - cpu_start, tags.load());
  return 0;
}
