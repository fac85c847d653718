// SPDX-License-Identifier: Apache-2.0
//
// Watches the folders of the cameras while images arrive.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "apps/workbench/project/project.h"
#include "calib/files/frame_images.h"

namespace plenocal::workbench {

/// An image that has arrived.
struct Arrival {
  std::string camera;
  FrameImage image;
};

/// Images that arrive in the folders of the session's cameras.
class Watch {
 public:
  explicit Watch(Project* project) : project_(project) {}

  /// Begins to watch; all images that are there count as new.
  void Start();
  void Stop();
  [[nodiscard]] bool On() const;
  /// Images that are new or of another size, once all of them are written to the end: their sizes
  /// are those of the look before, at least half a second ago. They are no longer new then.
  std::vector<Arrival> Arrived();

 private:
  using Sizes = std::map<std::filesystem::path, std::uintmax_t>;
  [[nodiscard]] std::vector<Arrival> Look() const;

  Project* project_;
  mutable std::mutex mutex_;
  bool on_ = false;
  Sizes known_, last_;
  std::chrono::steady_clock::time_point looked_;
};

}  // namespace plenocal::workbench
