// SPDX-License-Identifier: Apache-2.0
//
// Images whose detections are those of an earlier run, so that tests state what detectors find.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "calib/base/error.h"
#include "calib/camera/observation_entry.h"
#include "calib/files/frame_images.h"
#include "calib/files/image_store.h"
#include "calib/io/detection_cache.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {

/// What is found in one image.
struct FoundInImage {
  ImageSize size{640, 480};
  std::vector<Observation> points = {};
  double blur = 0;
  std::string why = {};                    ///< there are no points
  std::vector<std::string> left_out = {};  ///< markers, with reasons
  double saturated = 0;
  int orientation = 1;
};

/// The part of an entry of the cache that tests state (detectors/images/detect_images.cc).
template <MaybeConst<FoundInImage> T>
auto EntryMembers(T& found) {
  static const int layout_evidence = 0;
  static const std::vector<int> none;
  static const std::string levels, layout;
  return std::tie(found.size,
                  found.orientation,
                  found.blur,
                  found.saturated,
                  levels,
                  found.points,
                  found.left_out,
                  found.why,
                  none,
                  none,
                  layout,
                  layout_evidence,
                  none);
}

/// Grey images; their content is their number.
class NumberedImages : public ImageStore {
 public:
  [[nodiscard]] StoredImage Read(std::size_t index) const override {
    if (unreadable.contains(index)) throw Error(ErrorKind::kInput, "is damaged");
    const auto width = static_cast<std::size_t>(size[0]);
    return {.bytes = std::vector<std::uint8_t>(width * static_cast<std::size_t>(size[1]), 100),
            .encoding = "mono8",
            .size = size,
            .step = width};
  }
  [[nodiscard]] StoredImage Start(std::size_t index, std::size_t) const override {
    return Read(index);
  }
  [[nodiscard]] std::string Hash(std::size_t index) const override {
    return fmt::format("{} {}", name, index);
  }

  std::string name;
  ImageSize size{640, 480};
  std::set<std::size_t> unreadable = {};
};

/// A cache with the detections of images.
class EarlierDetections {
 public:
  /// The images of one camera.
  std::vector<FrameImage> Images(const std::string& camera,
                                 const std::vector<std::pair<std::string, FoundInImage>>& found,
                                 const std::set<std::size_t>& unreadable = {}) {
    const auto store = std::make_shared<NumberedImages>();
    store->name = camera;
    if (!found.empty()) store->size = found[0].second.size;
    store->unreadable = unreadable;
    std::vector<FrameImage> images;
    for (const auto& [frame, in_image] : found) {
      const std::size_t index = images.size();
      images.push_back(
          {.frame = frame, .path = camera + "/" + frame, .store = store, .index = index});
      if (unreadable.contains(index)) continue;
      cache.Save(cache.Key({"markers", "plain", store->Hash(index)}), PackEntry(in_image));
    }
    return images;
  }

 private:
  TemporaryFolder folder_;

 public:
  DetectionCache cache{folder_ / "cache", "test", false};
};

inline Observation PointAt(int marker, double x, double y, double sigma = 0.1) {
  Observation point{.marker = marker, .detector_sigma = sigma};
  point.values[0] = x;
  point.values[1] = y;
  return point;
}

}  // namespace plenocal::testing
