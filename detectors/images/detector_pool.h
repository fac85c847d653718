// SPDX-License-Identifier: Apache-2.0
//
// Marker detectors shared by threads.
#pragma once

#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "detectors/images/marker_detector.h"

namespace plenocal {

/// Detectors hold tables that are costly to build: one a thread, lent to one image at a time.
class DetectorPool {
 public:
  explicit DetectorPool(MarkerDetectorFactory make_detector)
      : make_detector_(std::move(make_detector)) {}

  MarkerDetections Detect(const cv::Mat& gray) {
    std::unique_ptr<MarkerDetector> detector = Take();
    MarkerDetections found = detector->Detect(gray);
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(detector));
    return found;
  }

 private:
  std::unique_ptr<MarkerDetector> Take() {
    {
      const std::lock_guard lock(mutex_);
      if (!idle_.empty()) {
        auto detector = std::move(idle_.back());
        idle_.pop_back();
        return detector;
      }
    }
    return make_detector_();
  }

  MarkerDetectorFactory make_detector_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<MarkerDetector>> idle_;
};

}  // namespace plenocal
