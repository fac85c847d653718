// SPDX-License-Identifier: Apache-2.0
//
// The way to libapriltag.
#pragma once

#include <apriltag/apriltag.h>

#include <functional>
#include <opencv2/core.hpp>

namespace plenocal::internal {

/// libapriltag's detector on one thread: the only place that calls it, so that no image reaches it
/// that it does not take.
class AprilTagLibrary {
 public:
  AprilTagLibrary();
  ~AprilTagLibrary();
  AprilTagLibrary(const AprilTagLibrary&) = delete;
  AprilTagLibrary& operator=(const AprilTagLibrary&) = delete;

  /// Tags of `family`, which must live as long as this, are read with so many wrong bits.
  void Add(apriltag_family_t* family, int most_wrong_bits);
  /// Outlines with less contrast than the noise of `gray` are left aside in images read next.
  void AdaptToNoise(const cv::Mat& gray);
  /// Calls then(tag) for the tags of `gray` (8 bits), whose outlines are searched on the image
  /// reduced by `decimate`, or by more where the library takes no image so large; corners count
  /// from the corner of a pixel. An image too small for any outline has no tags.
  void Read(const cv::Mat& gray,
            int decimate,
            const std::function<void(const apriltag_detection_t&)>& then);
  /// How many outlines the last image had.
  [[nodiscard]] int Outlines() const { return detector_->nquads; }

 private:
  apriltag_detector_t* detector_;
};

}  // namespace plenocal::internal
