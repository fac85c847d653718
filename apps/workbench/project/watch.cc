// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/project/watch.h"

#include <algorithm>
#include <string>
#include <utility>

#include "calib/base/error.h"
#include "calib/files/frame_images.h"

namespace plenocal::workbench {

void Watch::Start() {
  const std::lock_guard lock(mutex_);
  on_ = true;
  known_.clear();
  last_.clear();
}

void Watch::Stop() {
  const std::lock_guard lock(mutex_);
  on_ = false;
}

bool Watch::On() const {
  const std::lock_guard lock(mutex_);
  return on_;
}

Watch::Sizes Watch::Look() const {
  Sizes sizes;
  const Session session = project_->Parsed();
  for (const SessionCamera& camera : session.cameras) {
    if (camera.images.empty()) continue;
    try {
      for (const FrameImage& image : ExpandImages(camera.images, camera.name)) {
        std::error_code error;
        const std::uintmax_t size = std::filesystem::file_size(image.path, error);
        if (!error) sizes.emplace(image.path, size);
      }
    } catch (const Error&) {
      continue;  // a folder without an image yet
    }
  }
  return sizes;
}

bool Watch::Arrived() {
  constexpr auto kPause = std::chrono::milliseconds(500);
  const auto now = std::chrono::steady_clock::now();
  const std::lock_guard lock(mutex_);
  if (!on_ || now - looked_ < kPause) return false;
  looked_ = now;
  Sizes sizes;
  try {
    sizes = Look();
  } catch (const Error&) {
    return false;  // the page shows what is wrong with the session
  }
  const bool any_new = std::ranges::any_of(sizes, [&](const auto& image) {
    const auto known = known_.find(image.first);
    return known == known_.end() || known->second != image.second;
  });
  const bool written = sizes == last_;
  last_ = std::move(sizes);
  if (!any_new || !written) return false;
  known_ = last_;
  return true;
}

}  // namespace plenocal::workbench
