// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/project/session_images.h"

#include "apps/workbench/project/beneath.h"
#include "engine/recording/stores/image_lister.h"

namespace plenocal::workbench {

namespace fs = std::filesystem;

std::vector<FrameImage> SessionImages::Of(const SessionCamera& camera) {
  const std::string what = camera.name + ": images";
  std::map<fs::path, fs::file_time_type> times;
  for (const std::string& pattern : camera.images) {
    const fs::path file = SplitStorePattern(pattern).file;
    if (file.empty()) continue;
    // No link leads out of the root.
    const fs::path real = fs::canonical(file);
    (void)RelativeTo(root_, real);
    times[real] = fs::last_write_time(real);
  }
  if (times.empty()) return ExpandImages(camera.images, what);
  const std::lock_guard lock(mutex_);
  Listed& listed = listed_[camera.images];
  if (listed.times != times) listed = {times, ListImages(camera.images, what)};
  return listed.images;
}

}  // namespace plenocal::workbench
