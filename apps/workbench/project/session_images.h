// SPDX-License-Identifier: Apache-2.0
//
// Lists the images of a session's cameras, those of recordings once.
#pragma once

#include <filesystem>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "calib/files/frame_images.h"
#include "calib/files/session.h"

namespace plenocal::workbench {

/// The images of the session's cameras: files as they are now, recordings, videos and archives as
/// they were listed last, unless their file has changed.
class SessionImages {
 public:
  explicit SessionImages(std::filesystem::path root) : root_(std::move(root)) {}

  /// Throws `Error` of kind kInput when there are none, and for a recording that does not lie
  /// beneath the root.
  std::vector<FrameImage> Of(const SessionCamera& camera);

 private:
  struct Listed {
    std::map<std::filesystem::path, std::filesystem::file_time_type> times;  // of the files
    std::vector<FrameImage> images;
  };

  std::filesystem::path root_;
  std::mutex mutex_;
  std::map<std::vector<std::string>, Listed> listed_;  // by patterns
};

}  // namespace plenocal::workbench
