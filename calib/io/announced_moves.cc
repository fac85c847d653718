// SPDX-License-Identifier: Apache-2.0
#include "calib/io/announced_moves.h"

#include <sys/stat.h>
#include <unistd.h>

#include <system_error>

#include "calib/base/format_error.h"

namespace plenocal {

namespace fs = std::filesystem;

bool IsAnnounced(const fs::path& folder) {
  const fs::path partial = folder / kPartial;
  struct stat subfolder {
  }, complete{};
  if (lstat(partial.c_str(), &subfolder) != 0 ||
      lstat((partial / kComplete).c_str(), &complete) != 0) {
    return false;
  }
  const auto is_own = [](const struct stat& file) { return file.st_uid == geteuid(); };
  if (S_ISDIR(subfolder.st_mode) && S_ISREG(complete.st_mode) && is_own(subfolder) &&
      is_own(complete)) {
    return true;
  }
  throw JobError(
      "{}: looks like results that a killed run of another user left half moved; let that user run "
      "plenocal here, or remove it",
      partial.string());
}

std::vector<fs::path> AnnouncedAround(const fs::path& path) {
  constexpr int kLevels = 3;
  std::vector<fs::path> announced;
  std::error_code error;
  fs::path folder = fs::absolute(path, error).lexically_normal();
  if (!folder.has_filename()) folder = folder.parent_path();  // "OUT/"
  for (int level = 0; level <= kLevels; ++level, folder = folder.parent_path()) {
    if (folder.filename() != kPartial && IsAnnounced(folder)) announced.push_back(folder);
  }
  return announced;
}

void RefuseHalfMoved(const fs::path& path) {
  for (int tries = 0; tries < kTries; ++tries) {
    if (AnnouncedAround(path).empty()) return;
    usleep(kPause);
  }
  for (const fs::path& folder : AnnouncedAround(path)) {
    throw JobError(
        "{}: its results are half moved, by a run that was killed or by another run that is still "
        "at work; name this folder to a command of plenocal, which completes them",
        folder.string());
  }
}

}  // namespace plenocal
