// SPDX-License-Identifier: Apache-2.0
#include "engine/session/run_folders.h"

#include <fmt/format.h>

#include <algorithm>

#include "calib/files/session.h"
#include "calib/io/own_file.h"

namespace plenocal {

DetectionCache OpenDetectionCache(const std::filesystem::path& out,
                                  const Session& session,
                                  EarlierDetections earlier) {
  // Given detections are not cached, and hashing the program takes as long as solving a small
  // session.
  const bool detects = !out.empty() && std::ranges::any_of(session.cameras, HasImages);
  const std::string program =
      detects
          ? fmt::format(
                "plenocal {} {} {}", PLENOCAL_VERSION, HashFile(OwnFile()), session.target.Text())
          : std::string();
  return {out.empty() ? out : out / ".cache", program, earlier == EarlierDetections::kIgnore};
}

RunFolders::RunFolders(const SessionOptions& options,
                       const Session& session,
                       const std::vector<std::string>& results)
    : out_(OpenOutput(options.out)),
      cache_(OpenDetectionCache(
          options.cache.empty() ? options.out : options.cache,
          session,
          options.fresh ? EarlierDetections::kIgnore : EarlierDetections::kReuse)),
      owns_cache_(options.cache.empty()) {
  if (out_) out_->RefuseInputs(results);
}

void RunFolders::Commit() {
  if (!out_) return;
  out_->Commit();
  if (owns_cache_) cache_.RemoveUnused();
}

}  // namespace plenocal
