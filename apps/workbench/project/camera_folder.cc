// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/project/camera_folder.h"

#include <fnmatch.h>

#include "apps/workbench/project/beneath.h"
#include "calib/files/frame_images.h"
#include "engine/recording/stores/image_lister.h"

namespace plenocal::workbench {
namespace {

namespace fs = std::filesystem;

constexpr const char* kGlob = "*?[";

}  // namespace

bool CameraFolder::Has(const std::string& name) const {
  return HasImageName(name) && fnmatch(names.c_str(), name.c_str(), FNM_PERIOD) == 0;
}

std::optional<CameraFolder> FolderOf(const fs::path& root, const SessionCamera& camera) {
  for (const std::string& pattern : camera.images) {
    if (!SplitStorePattern(pattern).file.empty()) continue;
    fs::path path = root / pattern;
    std::error_code error;
    const bool is_folder = path.filename().empty() || fs::is_directory(path, error);
    const std::string names = is_folder ? "*" : path.filename().string();
    if (!is_folder || path.filename().empty()) path = path.parent_path();
    if (names.find_first_of(kGlob) == std::string::npos || !IsBeneath(root, path)) continue;
    fs::path folder = RelativeTo(root, path);
    if (folder == ".") folder.clear();
    if (folder.string().find_first_of(kGlob) == std::string::npos) return {{folder, names}};
  }
  return std::nullopt;
}

}  // namespace plenocal::workbench
