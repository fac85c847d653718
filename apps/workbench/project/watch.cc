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

std::vector<Arrival> Watch::Look() const {
  std::vector<Arrival> images;
  const Session session = project_->Parsed();
  for (const SessionCamera& camera : session.cameras) {
    if (camera.images.empty()) continue;
    try {
      for (FrameImage& image : ExpandImages(camera.images, camera.name)) {
        images.push_back({camera.name, std::move(image)});
      }
    } catch (const Error&) {
      continue;  // a folder without an image yet
    }
  }
  return images;
}

std::vector<Arrival> Watch::Arrived() {
  constexpr auto kPause = std::chrono::milliseconds(500);
  const auto now = std::chrono::steady_clock::now();
  const std::lock_guard lock(mutex_);
  if (!on_ || now - looked_ < kPause) return {};
  looked_ = now;
  std::vector<Arrival> images;
  try {
    images = Look();
  } catch (const Error&) {
    return {};  // the page shows what is wrong with the session
  }
  Sizes sizes;
  std::erase_if(images, [&](const Arrival& each) {
    std::error_code error;
    const std::uintmax_t size = std::filesystem::file_size(each.image.path, error);
    if (error) return true;
    sizes.emplace(each.image.path, size);
    const auto known = known_.find(each.image.path);
    return known != known_.end() && known->second == size;
  });
  const bool written = sizes == last_;
  last_ = std::move(sizes);
  if (!written) return {};
  if (!images.empty()) known_ = last_;
  return images;
}

}  // namespace plenocal::workbench
