// SPDX-License-Identifier: Apache-2.0
#include "detectors/apriltag/apriltag_library.h"

#include <algorithm>
#include <cstdint>

#include "detectors/apriltag/least_contrast.h"

namespace plenocal::internal {

AprilTagLibrary::AprilTagLibrary() : detector_(apriltag_detector_create()) {
  detector_->nthreads = 1;
}

AprilTagLibrary::~AprilTagLibrary() { apriltag_detector_destroy(detector_); }

void AprilTagLibrary::Add(apriltag_family_t* family, int most_wrong_bits) {
  apriltag_detector_add_family_bits(detector_, family, most_wrong_bits);
}

void AprilTagLibrary::AdaptToNoise(const cv::Mat& gray) {
  detector_->qtp.min_white_black_diff = LeastContrast(gray);
}

void AprilTagLibrary::Read(const cv::Mat& gray,
                           int decimate,
                           const std::function<void(const apriltag_detection_t&)>& then) {
  // The library's thresholds are those of whole tiles of the reduced image: without one it reads
  // outside of its memory. Beyond the largest side it ends the program.
  constexpr int kTile = 4, kLargest = 32767;  // px
  const auto [shorter, longer] = std::minmax(gray.cols, gray.rows);
  decimate = std::max(decimate, (longer - 1) / kLargest + 1);
  detector_->nquads = 0;
  if ((shorter - 1) / decimate + 1 < kTile) return;
  detector_->quad_decimate = static_cast<float>(decimate);
  image_u8_t image{gray.cols, gray.rows, static_cast<std::int32_t>(gray.step), gray.data};
  zarray_t* detections = apriltag_detector_detect(detector_, &image);
  for (int i = 0; i < zarray_size(detections); ++i) {
    apriltag_detection_t* found = nullptr;
    zarray_get(detections, i, &found);
    then(*found);
  }
  apriltag_detections_destroy(detections);
}

}  // namespace plenocal::internal
